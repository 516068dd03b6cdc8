# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers on command lines: none may end a long measurement in the middle or without figures."""

from collections.abc import Callable

import pytest

from studies.accuracy import __main__ as accuracy
from studies.change import __main__ as change
from studies.net import __main__ as net_study
from studies.paper import __main__ as paper
from studies.planner import __main__ as planner_study
from studies.stream import __main__ as stream_study
from terrain_estimator.cli import demo, rate_check, selftest


@pytest.mark.parametrize(
    ("main", "wrong"),
    [
        (accuracy.main, ("--jobs", "0")),
        (accuracy.main, ("--episodes", "0")),
        (stream_study.main, ("--jobs", "-1")),
        (stream_study.main, ("--batches", "0")),
        (change.main, ("--jobs", "0")),
        (paper.main, ("--jobs", "0")),
        (paper.main, ("--trainings", "0")),
        (planner_study.main, ("--drives", "0")),
        (planner_study.main, ("--seed", "-1")),
        (net_study.main, ("--episodes", "0")),
        (demo.main, ("--duration", "0")),  # which the simulator takes for endless
        (selftest.main, ("--duration", "0")),
        (rate_check.main, ("--duration", "0")),
    ],
)
def test_a_number_that_gives_no_figures_is_refused_by_its_option(
    capsys: pytest.CaptureFixture[str], main: Callable[[list[str]], int], wrong: tuple[str, str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(list(wrong))
    assert ended.value.code == 2
    assert f"argument {wrong[0]}: {wrong[1]}: give " in capsys.readouterr().err
