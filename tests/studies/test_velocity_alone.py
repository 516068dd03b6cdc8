# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of slips, sinkages and velocity alone, on two drives through the commands."""

import dataclasses
import math
from pathlib import Path

import pytest

from studies import velocity_alone
from studies.velocity_alone import (
    CASES,
    EXACT,
    LINEAR,
    Result,
    Told,
    figures,
    mapping_of,
    result_of,
)
from terrain_estimator.importing.mapping import read_mapping
from terramechanics.presets import load_rover

ROOT = Path(__file__).parents[2]


def test_two_drives_go_through_the_commands_and_are_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    case = dataclasses.replace(CASES["closed"], models=(Told(LINEAR, EXACT),))
    [line] = velocity_alone.judge(case, "loose_sand", 2, 7, tmp_path / "case")
    assert line[:3] == ["closed form, loose sand", "linear_stress", "0"]
    c, tan_phi = (float(each) for each in line[3].removesuffix(" %").split(" / "))
    assert 0.0 < c < 20.0
    assert 0.0 < tan_phi < 10.0
    assert line[4].endswith(" of 2")
    assert line[5:] == ["0", "0"]


@pytest.mark.parametrize("name", CASES)
def test_the_mapping_names_wheels_of_the_rover(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    case = CASES[name]
    mapping = read_mapping(mapping_of(case, tmp_path))
    assert tuple(wheel.name for wheel in mapping.wheels) == case.wheels
    assert set(case.wheels) <= set(load_rover(case.rover).wheel_names)


def test_drives_without_an_estimate_count_for_no_error() -> None:
    told = {"cohesion_pa": {"mean": 1100.0, "lower_95": 900.0, "upper_95": 1300.0}}
    told["tan_phi"] = {"mean": 0.66, "lower_95": 0.65, "upper_95": 0.67}
    found = result_of({"status": "CONVERGING", "estimate": told}, [1000.0, 0.6])
    nothing = result_of({"status": "DISAGREES", "estimate": {}}, [1000.0, 0.6])
    assert math.isnan(nothing.mean[0])
    assert figures([found, nothing]) == ["10 / 10 %", "1 / 0 of 1", "0", "1"]
    assert isinstance(found, Result)
