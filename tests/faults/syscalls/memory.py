# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""MemoryError at the calls of our own functions, counted from 1 in all threads."""

import sys
import threading
from types import FrameType
from typing import Any

OURS = "/terrain_estimator/terrain_estimator/"
PASSED_OVER = ("/console/",)
"""The lines that report an error need memory themselves."""


def _begins_thread(frame: FrameType) -> bool:
    """Return whether a thread begins with this function: nothing of ours could take its error."""
    caller = frame.f_back
    return caller is not None and caller.f_code.co_filename == threading.__file__


class Shortage:
    """A tracer that raises MemoryError when a function of ours is called for the n-th time."""

    def __init__(self, number: int) -> None:
        """Take the number of the call; 0 counts only."""
        self.seen = 0
        self.place = ""
        self._number = number

    def start(self) -> None:
        """Trace this thread and those that it starts."""
        threading.settrace(self._enter)
        sys.settrace(self._enter)

    def stop(self) -> None:
        """Trace no more."""
        sys.settrace(None)
        threading.settrace(None)

    def _enter(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or OURS not in code.co_filename or code.co_name.startswith("<"):
            return
        if any(part in code.co_filename for part in PASSED_OVER) or _begins_thread(frame):
            return
        self.seen += 1
        if self.seen == self._number:
            self.place = f"{code.co_filename.partition(OURS)[2]}:{code.co_qualname}"
            raise MemoryError
