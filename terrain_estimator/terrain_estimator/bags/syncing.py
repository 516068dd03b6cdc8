# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Brings a growing file to the disk at intervals, beside the thread that writes it."""

import os
import threading
from typing import BinaryIO


class Syncer:
    """A thread that calls fsync about every ``interval_s``; fsync can take long, so the writer does not wait for it."""

    def __init__(self, file: BinaryIO, interval_s: float) -> None:
        """Start.

        Args:
            file: open until after :meth:`stop`.
            interval_s: [s] what a power cut may cost.
        """
        self._descriptor = file.fileno()
        self._interval_s = interval_s
        self._stopped = threading.Event()
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="fsync", daemon=True)
        self._thread.start()

    def check(self) -> None:
        """Raise the OSError that the disk reported, if it did."""
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._interval_s):
            try:
                os.fsync(self._descriptor)
            except OSError as error:
                self._error = error
                return
