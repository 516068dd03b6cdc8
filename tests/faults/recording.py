# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Faults that happen to a running recorder."""

import resource
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray

from msg_defs.msg import WheelSlip
from terrain_estimator.bags import BagReader
from terrain_estimator.topics import stamp_ns
from tests.faults.fault import Expected, Fault, Seen
from tests.faults.logs import log_lines, worst_levels
from tests.faults.rover import PATIENCE_S
from tests.faults.syscalls.filter import armed, compiled
from tests.system.listening import Listener
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until

BEFORE = 100
"""[messages] recorded before the fault."""
AFTER = 2000
AGAIN = 20
"""[messages] for another recorder, which has to record all of them."""
SMALL_DISK_BYTES = 96 << 10
FAILING_CALL = 300
"""After the BEFORE messages, whose writes and fsyncs are fewer."""


def of_recorder(
    name: str,
    what: str,
    happen: Callable[[Process, Path], None],
    expected: Expected,
    filtered: tuple[int, str] | None = None,
) -> Fault:
    """Row of a recorder's fault: messages before it, the fault, its end, another recorder.

    ``filtered`` is a call on the bag that fails, and how.
    """

    def run(folder: Path, domain_id: int) -> Seen:
        with (
            Starter(folder, domain_id) as start,
            Listener(domain_id) as listener,
            small_disk(folder / "disk") as disk,
        ):
            diagnostics = listener.collect(DiagnosticArray, "/diagnostics")
            whole = start.environment
            if filtered and (library := compiled(folder)):
                start.environment = whole | armed(library, disk, *filtered)
            recorder = _record(start, disk / "run")
            start.environment = whole
            publisher = listener.publisher(WheelSlip, "wheel_slip", timeout=PATIENCE_S)
            for number in range(BEFORE):
                publisher.publish(WheelSlip(sequence=number))
            wait_until(
                lambda: len(recorded(disk / "run")) == BEFORE, "all are recorded", PATIENCE_S
            )
            listener.spin_until(
                lambda: diagnostics and _is_well(diagnostics[-1]), "it is well", PATIENCE_S
            )
            begun = len(diagnostics)
            happen(recorder, disk / "run")
            for number in range(BEFORE, BEFORE + AFTER):
                if recorder.running:
                    publisher.publish(WheelSlip(sequence=number))
                    listener.spin_until(
                        lambda: True, "callbacks are served"
                    )  # which takes a moment: the queue is not to overflow
            code = recorder.wait(PATIENCE_S)
            meanwhile = worst_levels(diagnostics[begun:], "recorder")
            begin = time.monotonic()
            second = _record(start, folder / "next")
            listener.spin_until(
                lambda: "recording 1 topics" in second.output,
                "another recorder has matched",
                PATIENCE_S,
            )
            back_after_s = time.monotonic() - begin
            again = _recorded_again(domain_id, folder / "next")
            again_ns = time.time_ns()
            listener.spin_until(
                lambda: stamp_ns(diagnostics[-1]) > again_ns, "its diagnostics came", PATIENCE_S
            )
            found = recorded(disk / "run")
            return Seen(
                outcomes={f"exit code {code}": 1},
                diagnostics=meanwhile,
                log=tuple(dict.fromkeys(log_lines(recorder.output))),
                back_after=AGAIN - len(again),
                back_after_s=back_after_s,
                lost=len(set(range(max(BEFORE, len(found)))) - set(found)),
                kept=set(range(BEFORE)) <= set(found),
                well_again=_is_well(diagnostics[-1]),
            )

    return Fault(name, what, expected, run, lost_is="messages that were recorded before")


def _is_well(diagnostics: DiagnosticArray) -> bool:
    return not worst_levels([diagnostics], "recorder")


def _recorded_again(domain_id: int, folder: Path) -> list[int]:
    """Return the messages of a new recorder, once it has the last of AGAIN from a new publisher."""
    with Listener(domain_id) as other:
        publisher = other.publisher(WheelSlip, "wheel_slip", timeout=PATIENCE_S)
        for number in range(AGAIN):
            publisher.publish(WheelSlip(sequence=number))
        wait_until(
            lambda: recorded(folder)[-1:] == [AGAIN - 1], "the last message is recorded", PATIENCE_S
        )
        return recorded(folder)


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """Mount a small file system; a plain folder where this process may not mount."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK_BYTES}", "tmpfs", str(folder)]
    mounted = subprocess.run(command, check=False, capture_output=True)
    try:
        yield folder
    finally:
        if mounted.returncode == 0:
            subprocess.run(["umount", str(folder)], check=True)


def recorded(folder: Path) -> list[int]:
    """Return the sequence numbers that can be read, of finished and unfinished files."""
    if not list(folder.glob("*.mcap")):
        return []
    with BagReader(folder) as reader:
        return [reader.decode(message).sequence for message in reader.messages(["/wheel_slip"])]


def _record(start: Starter, folder: Path) -> Process:
    return start(
        "terrain_estimator",
        "recorder",
        "--ros-args",
        "-p",
        f"output:={folder}",
        "-p",
        "topics:=wheel_slip",
    )


def _fill(recorder: Process, folder: Path) -> None:
    """Limit the size of the file where the disk is not small."""
    if not folder.parent.is_mount():
        room = sum(file.stat().st_size for file in folder.iterdir()) + 1000
        resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (room, room))


def _nothing(_: Process, __: Path) -> None:
    """Leave it to the filter."""


def _kill(recorder: Process, _: Path) -> None:
    recorder.signal(signal.SIGKILL)


FAULTS = (
    of_recorder(
        "disk full",
        f"the recorder writes to a file system of {SMALL_DISK_BYTES >> 10} KiB until it is full",
        _fill,
        Expected(
            frozenset({"exit code 1"}),
            {},
            log=("^the disk fails, what was written before is kept: .*",),
        ),
    ),
    of_recorder(
        "a write fails",
        f"call {FAILING_CALL} of the recorder on its bag reports EIO, once",
        _nothing,
        Expected(
            frozenset({"exit code 1"}),
            {},
            log=("^the disk fails, what was written before is kept: .*Input/output error",),
        ),
        (FAILING_CALL, "EIO"),
    ),
    of_recorder(
        "kill -9 of the recorder",
        "the recorder is killed while it records",
        _kill,
        Expected(frozenset({"exit code -9"}), {}),
    ),
)
