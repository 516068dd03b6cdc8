# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of the planner, at its smallest size."""

import dataclasses
import json
import math
from pathlib import Path

import pytest

from studies.planner import patches
from studies.planner.__main__ import main, table
from studies.planner.patches import PatchOutcome
from studies.planner.scores import score
from terrain_estimator.planning.planner import Reason

PASSED = PatchOutcome("", 20.0, math.inf, math.inf, math.inf, Reason.NONE, math.nan, 0, holds=True)
TRAPPED = dataclasses.replace(PASSED, stuck_s=30.0)
STOPPED = dataclasses.replace(
    PASSED, stop_s=24.0, rest_s=25.0, reason=Reason.FRONT, slip=0.2, axles=1, holds=False
)
SAVED = dataclasses.replace(STOPPED, stuck_s=30.0, effect="grousers")


def test_a_small_study_writes_every_drive(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patches, "DURATION_S", 3.0)
    monkeypatch.setattr(patches, "STARTS", (0.75, 0.8))
    out = tmp_path / "study.json"
    assert main(["--drives", "3", "--seed", "5", "--out", str(out)]) == 0
    figures = json.loads(out.read_text())
    assert [math.isfinite(drive["met_s"]) for drive in figures["drives"]] == [True] * 3
    assert "| all | 3 |" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["--soil", "cheese"], "cheese"), (["--stop-probability", "2"], "stop_probability")],
)
def test_a_wrong_argument_is_named(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert words in capsys.readouterr().err


def test_a_stop_in_time_saves_a_rover_and_a_stop_where_it_would_pass_is_false() -> None:
    too_late = dataclasses.replace(SAVED, rest_s=30.5)
    never_met = dataclasses.replace(TRAPPED, met_s=math.inf)
    result = score([PASSED, PASSED, TRAPPED, STOPPED, SAVED, too_late, never_met])
    assert (result.drives, result.trapped, result.too_weak) == (6, 3, 1)
    assert result.saved is not None
    assert result.false_stops is not None
    assert result.saved.value == pytest.approx(1.0 / 3.0)
    assert result.false_stops.value == pytest.approx(1.0 / 3.0)
    assert result.firm_axles == 2.0
    assert result.saved.low < 1.0 / 3.0 < result.saved.high


def test_the_table_separates_drives_with_an_effect_from_those_without() -> None:
    lines = table([PASSED, SAVED]).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["all", "no effect", "one effect"]
