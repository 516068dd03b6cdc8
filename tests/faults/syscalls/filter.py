# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The preload filter, compiled for the test, and its interface."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

SOURCE = Path(__file__).with_name("filter.c")
CALLS = ("open", "write", "fsync", "rename", "close", "mkdir")
KINDS = {"EIO": 1, "ENOSPC from then on": 2, "short write": 3, "EINTR": 4}
NOTHING = 0


class Passed(NamedTuple):
    """Calls that passed the filter."""

    seen: int
    hits: int  # that failed
    call: str  # the first one that failed


def compiled(folder: Path) -> Path | None:
    """Compile the filter; return None where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    library = folder / "filter.so"
    command = [compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(SOURCE), "-ldl"]
    subprocess.run(command, check=True)
    return library


def environment(library: Path) -> dict[str, str]:
    """Return the environment of a process with the filter."""
    return os.environ | {"LD_PRELOAD": str(library)}


def armed(library: Path, folder: Path, number: int, kind: str) -> dict[str, str]:
    """Return variables that arm the filter in a program that knows nothing of it."""
    return {
        "LD_PRELOAD": str(library),
        "FAULT_FOLDER": str(folder.resolve()),
        "FAULT_NUMBER": str(number),
        "FAULT_KIND": str(KINDS[kind]),
    }


class Filter:
    """The filter of this process, which was started with it."""

    def __init__(self) -> None:
        """Find the preloaded functions."""
        self._library = ctypes.CDLL(None)
        self._library.fault_seen.restype = ctypes.c_long
        self._library.fault_hits.restype = ctypes.c_long

    def arm(self, folder: Path, number: int, kind: int) -> None:
        """Count calls below ``folder`` and let the one of this number fail; 0 counts only."""
        self._library.fault_arm(os.fsencode(folder), ctypes.c_long(number), kind)

    def disarm(self) -> Passed:
        """Let all calls pass."""
        self._library.fault_disarm()
        call = self._library.fault_call()
        return Passed(
            self._library.fault_seen(), self._library.fault_hits(), CALLS[call] if call >= 0 else ""
        )
