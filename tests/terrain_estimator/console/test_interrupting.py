# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Interrupted commands end with one line, and their processes end with them."""

import itertools
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from terrain_estimator.bags import BagWriter, Types
from terrain_estimator.bags.writing.part import BagTopic
from terrain_estimator.cli import replay
from terrain_estimator.console.interrupting import INTERRUPTED, interruptible
from tests.drives import drive_messages, write_bag
from tests.samples import sampled

SETUP = Path(__file__).parents[3] / "terrain_estimator" / "setup.py"
ENDING_S = 30.0
WORKING = """
import os, sys, time
from terrain_estimator.console.interrupting import interruptible
from studies.workers import workers

@interruptible
def main():
    with workers(2) as pool:
        up = set()
        while len(up) < 2:  # both of them have taken something
            up |= {each.result() for each in [pool.submit(os.getpid) for _ in range(20)]}
        print("working", flush=True)
        return len([pool.submit(time.sleep, 600.0) for _ in range(5)][0].result())

if __name__ == "__main__":
    sys.exit(main())
"""


@pytest.mark.parametrize(
    ("number", "send"),
    sampled(
        [(signal.SIGINT, os.killpg), (signal.SIGTERM, os.kill)],
        list(itertools.product([signal.SIGINT, signal.SIGTERM], [os.killpg, os.kill])),
    ),
    ids=lambda value: getattr(value, "name", "") or value.__name__,
)
def test_all_processes_of_a_long_computation_end_at_once_and_quietly(
    number: signal.Signals, send: Callable[[int, int], None]
) -> None:
    """Ctrl-C reaches the whole group, ``kill`` one process.

    The pipe's end is seen when no process holds it any more.
    """
    command = ["env", "--default-signal=INT", sys.executable, "-c", WORKING]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, sys.path))}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(
        command, **pipes, text=True, env=environment, start_new_session=True
    ) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == "working\n"
        send(process.pid, number)
        _, error = process.communicate(timeout=ENDING_S)
    assert process.returncode == INTERRUPTED
    assert error == "<string>: interrupted\n"


def test_a_signal_handler_is_left_as_it_was() -> None:
    before = signal.getsignal(signal.SIGTERM)
    assert interruptible(lambda: 3)() == 3
    assert signal.getsignal(signal.SIGTERM) is before


def test_every_command_is_interruptible() -> None:
    modules = re.findall(r"= (terrain_estimator\.cli\.\w+):main", SETUP.read_text(encoding="utf-8"))
    assert "terrain_estimator.cli.replay" in modules
    assert [name for name in modules if not hasattr(import_module(name).main, "__wrapped__")] == []


def test_an_interrupted_replay_leaves_nothing_that_is_in_the_way_of_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    types = Types()
    bag = write_bag(tmp_path / "drive", drive_messages(types.make, 2.0), types)
    write = BagWriter.write

    def interrupt(self: BagWriter, topic: BagTopic, *rest: Any) -> None:
        write(self, topic, *rest)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(BagWriter, "write", interrupt)
        assert replay.main([str(bag), "--out", str(tmp_path / "out")]) == INTERRUPTED
    assert "Traceback" not in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert replay.main([str(bag), "--out", str(tmp_path / "out")]) == 0
