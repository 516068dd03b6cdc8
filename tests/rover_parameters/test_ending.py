# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A process ends although something holds Python's lock, and only where it takes too long."""

import os
import subprocess
import sys
import time

import pytest

HOLDS_THE_LOCK = """
import ctypes
from rover_parameters.ending import exiting_after
with exiting_after({longest}, {code}):
    ctypes.PyDLL(None).sleep({taken})
print("it went on")
"""


def ran(longest: float, code: int, taken: int) -> subprocess.CompletedProcess[str]:
    program = HOLDS_THE_LOCK.format(longest=longest, code=code, taken=taken)
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )


@pytest.mark.parametrize("code", [0, 3])
def test_a_process_that_hangs_in_c_is_ended_with_its_code(code: int) -> None:
    begun = time.monotonic()
    done = ran(0.5, code, 50)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")
    assert time.monotonic() - begun < 40.0


def test_a_process_that_ends_in_time_goes_on() -> None:
    done = ran(30.0, 3, 1)
    assert (done.returncode, done.stdout) == (0, "it went on\n")


def test_a_timer_that_was_deleted_does_not_fire() -> None:
    program = (
        "import time\nfrom rover_parameters.ending import exiting_after\n"
        "with exiting_after(0.2, 3):\n    pass\ntime.sleep(1.0)\nprint('alive')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout) == (0, "alive\n")


@pytest.mark.parametrize("closing", [">&-", "2>&-", ">/dev/full", ">&- 2>&-"])
def test_a_closed_or_full_stream_is_no_error(closing: str) -> None:
    code = (
        "import os\nfrom rover_parameters.ending import exiting_after\nprint('text')\n"
        "with exiting_after(5.0, 3):\n    pass\nos._exit(0)\n"
    )
    shell = ["sh", "-c", f'"$1" -c "$2" {closing}', "sh", sys.executable, code]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(shell, env=buffered, check=False)
    assert done.returncode == 0
