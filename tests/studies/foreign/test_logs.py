# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The foreign drives: every log is whole, and one goes through csv_to_bag and replay."""

import json
from pathlib import Path

import numpy as np
import pytest

from studies.foreign import bag
from studies.foreign.drives import drive, observations_of
from studies.foreign.logs import TRUTH, log_names, measured_columns, read_log
from terrain_estimator.cli import replay
from terrain_estimator.model.model_file import load_model
from terramechanics.presets import load_rover

ROVER = load_rover("mars_rover")
TIMES = 500


def test_there_are_both_soils_every_drive_and_every_law() -> None:
    names = [name.split("_") for name in log_names()]
    assert len(names) == 22
    assert {soil for soil, _, _ in names} == set(TRUTH)
    assert {law for _, _, law in names} == {"scm", "radial", "tracks"}
    assert {drive for _, drive, _ in names} == {
        "cruise",
        "differential",
        "sines",
        "slopes",
        "steep",
    }


@pytest.mark.parametrize("name", log_names())
def test_a_log_is_whole_and_its_loads_carry_the_rover(name: str) -> None:
    log = read_log(name)
    assert log.name == name
    assert {len(column) for column in log.columns.values()} == {TIMES}
    assert np.allclose(np.diff(log.columns["time"]), 0.1, atol=1e-6)
    assert all(np.isfinite(column).all() for column in log.columns.values())
    loads = sum(log.columns[f"{wheel}_load"] for wheel in ROVER.wheel_names)
    assert np.mean(loads) == pytest.approx(ROVER.weight, rel=0.05)


def test_the_noise_is_that_of_the_seed_and_of_the_log() -> None:
    log, other = read_log("A_steep_scm"), read_log("A_steep_radial")
    first = measured_columns(log, 0)["velocity"] - log.columns["velocity"]
    again = measured_columns(log, 0)["velocity"] - log.columns["velocity"]
    assert (first == again).all()
    assert first.std() == pytest.approx(0.01, rel=0.15)
    for seed, another in ((1, log), (0, other)):
        drawn = measured_columns(another, seed)["velocity"] - another.columns["velocity"]
        assert abs(np.corrcoef(first, drawn)[0, 1]) < 0.2


def test_a_log_becomes_a_bag_whose_replay_ends_where_the_study_does(tmp_path: Path) -> None:
    """Most seconds fit far worse than noise explains, and are refused."""
    name = "A_cruise_tracks"
    assert bag.main([name, "--out", str(tmp_path)]) == 0
    assert replay.main([str(tmp_path / "bag"), "--out", str(tmp_path / "replay")]) == 3
    last = json.loads((tmp_path / "replay" / "summary.json").read_text())["bags"][0]
    log = read_log(name)
    driven = drive(log, observations_of(measured_columns(log, 0), ROVER), load_model("mars_rover"))
    assert last["estimates"] == TIMES
    assert last["outcomes"].get("ACCEPTED", 0) == driven.length @ driven.taken
    assert last["outcomes"]["GATED"] > TIMES // 2
    assert (last["status"], float(driven.disagrees)) == ("DISAGREES", 1.0)
