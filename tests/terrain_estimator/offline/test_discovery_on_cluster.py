# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect on a cluster: the same bytes, with a worker killed and a broken bag."""

import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.offline.cluster import Held
from tests.hidden.cases import Plan, draw_cases
from tests.hidden.sealing import seal
from tests.samples import sampled

ONE_EFFECT = ["--library", "drive_drag"]


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    case = draw_cases(Plan((("drive_drag", 1.0),), soil="loose_sand", seconds=18.0), 1, seed=5)[0]
    folder = tmp_path_factory.mktemp("sealed")
    found = [str(bag) for bag in seal(case, folder)]
    broken = folder / "broken"
    broken.mkdir()
    (broken / "broken_0.mcap").write_bytes(b"no bag")
    return [found[0], str(broken), *found[1:4]]


def finding(bags: list[str], out: Path, *extra: str) -> bytes:
    assert main([*bags[:-1], "--hold-out", bags[-1], *ONE_EFFECT, "--out", str(out), *extra]) == 0
    return (out / "finding.json").read_bytes()


def die_once(marker: Path, function: Callable[[Any, Any], Any], kept: Any, item: Any) -> Any:
    """Kill the first worker that calls this."""
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return function(kept, item)


def test_any_number_of_workers_gives_the_same_bytes_with_one_killed_and_a_broken_bag(
    bags: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    alone = finding(bags, tmp_path / "alone", "--workers", "1")
    assert b'"named"' in alone
    complaint = capsys.readouterr().err
    assert f"{bags[1]} is left out" in complaint
    for workers in sampled((), ("4",)):
        assert finding(bags, tmp_path / "four", "--workers", workers) == alone
        assert f"{bags[1]} is left out" in capsys.readouterr().err

    computed, marker, calls = Held.__call__, tmp_path / "killed", []

    def fatal(
        self: Held[Any], function: Callable[[Any, Any], Any], items: Sequence[Any]
    ) -> list[Any]:
        calls.append(len(items))
        if len(calls) < 6:
            return computed(self, function, items)
        return computed(self, lambda kept, item: die_once(marker, function, kept, item), items)

    monkeypatch.setattr(Held, "__call__", fatal)
    assert finding(bags, tmp_path / "two", "--workers", "2") == alone
    assert marker.exists()
    assert len(calls) > 6
    assert set(calls) == {3}


def test_a_scheduler_that_does_not_answer_is_a_wrong_argument(
    bags: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("terrain_estimator.offline.cluster.PATIENCE_S", 1.0)
    assert main([*bags, "--scheduler", "tcp://127.0.0.1:9"]) == 2
    assert "--scheduler tcp://127.0.0.1:9" in capsys.readouterr().err
