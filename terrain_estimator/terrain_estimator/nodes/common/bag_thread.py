# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Record a bag in a thread of its own, so that a disk that hangs does not stop the node."""

import itertools
import math
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rover_parameters.parameters import effective, fingerprint
from terrain_estimator.bags import BagError, BagExistsError, BagWriter, Split
from terrain_estimator.config.recorder import RecorderConfig
from terrain_estimator.files.worker import Worker

MOMENT_S = 0.5
"""Longest wait for a write: later messages wait in memory, and callbacks are served."""
BACKLOG_BYTES = 64 << 20
"""Largest backlog in memory: six minutes of the default topics."""
OVERHEAD_BYTES = 2000
"""Memory of a waiting message beside its data."""
UNNAMED = "bags"
"""The folder of bags without a given name."""
PATIENCE_S = 30.0
"""Longest wait of the end of a recording for a disk that takes nothing.

Three times the lateness that /diagnostics reports as an error, and a third of the time that systemd
gives a service to end.
"""
ResultT = TypeVar("ResultT")


class BagThread:
    """Bag that one thread makes, writes and finishes, as fast as the disk allows."""

    def __init__(self, config: RecorderConfig) -> None:
        """Make the bag.

        Raises:
            BagError: it cannot be made.
            TimeoutError: the disk does not answer.
        """
        self.abandoned = False
        self._worker = Worker("bag")
        made = self._worker.give(partial(_new_bag, config))
        if not self._awaited(made, lambda: 0.0):
            self._worker.give(lambda: made.result().discard())
            self._worker.end()
            raise TimeoutError(
                f"{config.output or UNNAMED}: the disk has taken nothing for {PATIENCE_S:g} s, so"
                " there is no bag"
            )
        if made.exception():
            self._worker.end()
        self.bag = made.result()

    @property
    def hangs(self) -> bool:
        """True where new actions wait in memory."""
        return self._worker.behind_s > MOMENT_S

    @property
    def late_s(self) -> float:
        """Loss [s] that a power cut would cause now, beyond the interval between two fsync."""
        return max(self.bag.late_s, self._worker.behind_s)

    def give(self, action: Callable[[], ResultT], size: int = 0) -> Future[ResultT]:
        """Queue an action on the bag; return when it is done, unless the disk hangs.

        Args:
            action: its errors are in the future alone.
            size: [bytes] of the message that it holds.

        Raises:
            BagError: too much waits already.
        """
        size += OVERHEAD_BYTES
        if self._worker.size + size > BACKLOG_BYTES:
            raise BagError(
                f"{self.bag.folder}: the disk hangs, and {BACKLOG_BYTES >> 20} MiB wait for it"
                " already"
            )
        hangs = self.hangs
        done = self._worker.give(action, size)
        if not hangs:
            wait([done], MOMENT_S)
        return done

    def abandon(self) -> None:
        """Leave the bag unfinished."""
        self.abandoned = True
        self._worker.give(self.bag.abandon)

    def wait(self, patience_s: float = PATIENCE_S) -> bool:
        """Let the thread end; return whether it has within ``patience_s``."""
        return self._worker.end(patience_s)

    def close(self, late: Callable[[str], object]) -> None:
        """Finish the bag.

        Args:
            late: called in the thread with the result, where the disk answers later.

        Raises:
            OSError: the disk is full or broken.
            TimeoutError: the disk has taken nothing for PATIENCE_S. The thread goes on, as long as
                the process does.
        """
        closed = self._worker.give(self.bag.close)
        self._worker.end()
        if not self._awaited(closed, lambda: self.bag.moved_s):
            closed.add_done_callback(
                lambda done: late(
                    f"{self.bag.folder}:"
                    f" {done.exception() or 'the disk has answered, all is written'}"
                )
            )
            raise TimeoutError(self._undone())
        closed.result()

    def _undone(self) -> str:
        hangs = f"{self.bag.path}: the disk has taken nothing for {PATIENCE_S:g} s"
        if self.bag.whole:
            return f"{hangs}: it stays uncompressed"
        waiting = self._worker.count - 1  # beside the end
        memory = (
            f"; {waiting} messages that wait in memory are lost when this process ends"
            if waiting
            else ""
        )
        return (
            f"{hangs}: the bag is left unfinished (recover_bag makes it whole). What is younger"
            f" than {self.bag.sync_interval_s + self.late_s:.0f} s is lost if the power fails"
            f" before the disk answers{memory}"
        )

    def _awaited(self, done: Future[Any], bag_moved_s: Callable[[], float]) -> bool:
        """Return False where the disk takes nothing for PATIENCE_S before it is done."""
        begun_s = time.monotonic()
        while not done.done():
            moved_s = max(begun_s, self._worker.moved_s, bag_moved_s())
            left_s = moved_s + PATIENCE_S - time.monotonic()
            if left_s <= 0.0:
                return False
            wait([done], left_s)
        return True


def _new_bag(config: RecorderConfig) -> BagWriter:
    """Make the bag; without a given name, number those of the same second.

    Two bags have one second where two recorders start, or a clock is reset by a reboot.
    """
    values = {name: str(value) for name, value in effective(config).items()}
    record_to = partial(
        BagWriter,
        recording=True,
        sync_interval_s=config.fsync_interval_s,
        split=Split(config.split_size_mb * 1e6 or math.inf, config.split_duration_s or math.inf),
        metadata={"recorder": values | {"configuration_sha256": fingerprint(effective(config))}},
    )
    if config.output:
        return record_to(Path(config.output).expanduser())
    name = f"{UNNAMED}/{datetime.now(UTC):%Y-%m-%dT%H-%M-%SZ}"
    names = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
    while True:
        with suppress(BagExistsError):
            return record_to(next(names))
