# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The foreign drives with turns: true forces balance, and bags of them go through replay."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from studies.foreign import bag, turns
from studies.foreign.logs import TRUTH, TURNS, Log, log_names, measured_columns, read_log
from studies.foreign.turns import TRACKS, places_of
from terrain_estimator.bags import BagReader
from terrain_estimator.cli import replay
from terrain_estimator.cli.model_by_wheel import main as model_by_wheel
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.messaging.conversion import Converter
from terrain_estimator.observation import Observation
from terrain_estimator.update import Update
from terramechanics.vehicle.wheel_balances import geometry_by_wheel, wheel_balances
from terramechanics.vehicle.wheel_places import wheel_order

TIMES = 500


def test_there_are_both_soils_both_rovers_and_every_drive() -> None:
    names = [name.split("_") for name in log_names(TURNS)]
    assert len(names) == 24
    assert {soil for soil, _, _ in names} == set(TRUTH)
    assert {kind for _, _, kind in names} == {"skid", "steered"}
    drives = {"straight", "weave", "circle", "across", "slopes", "manoeuvre"}
    assert {drive for _, drive, _ in names} == drives


def _wheels(log: Log, end: str) -> torch.Tensor:
    """Return a column of every wheel [T, wheels], in ``wheel_order``."""
    names = [log.rover.wheel_names[k] for k in wheel_order(log.rover)]
    return torch.from_numpy(np.stack([log.columns[f"{name}_{end}"] for name in names], 1))


@pytest.mark.parametrize("name", log_names(TURNS))
def test_the_true_forces_of_a_log_satisfy_the_balances_of_the_body(name: str) -> None:
    """The balances are the estimator's; the forces are Chrono's, means over 0.1 s.

    They are compared with the mean motion of a sample, which is what the estimator does.
    """
    log = read_log(name)
    columns = log.columns
    assert {len(column) for column in columns.values()} == {TIMES}
    assert all(np.isfinite(column).all() for column in columns.values())
    rover = log.rover
    geometry, side = geometry_by_wheel(rover, TRACKS[rover.name])
    bogie = torch.zeros(TIMES, len(rover.suspension), dtype=torch.float64)
    if rover.suspension:
        bogie[:, 0] = torch.from_numpy(columns["bogie"])
    rows = wheel_balances(geometry, side, _wheels(log, "steering"), _wheels(log, "contact"), bogie)
    forces = torch.stack([_wheels(log, end) for end in ("load", "drawbar", "torque", "side")], -1)
    found = (rows[:, 0] * forces.unsqueeze(1)).sum((-1, -2)).numpy()
    pitch, roll = columns["pitch"], columns["roll"]
    aside = np.gradient(columns["lateral_velocity"], columns["time"])
    aside += columns["velocity"] * columns["yaw_rate"] + rover.gravity * np.sin(roll)
    upright = rover.gravity * np.cos(pitch) * np.cos(roll)
    begun = columns["time"] > 2.0
    for row, specific in ((0, columns["acceleration"]), (1, aside), (3, upright)):
        left = (found[:, row] / rover.mass - specific)[begun] / rover.gravity
        assert abs(left.mean()) < 0.005
        assert left.std() < 0.01
    length = rover.axle_x[0] - rover.axle_x[-1]
    pitch_and_joints = found[begun][:, [4, *range(6, found.shape[1])]] / (rover.weight * length)
    assert (abs(pitch_and_joints.mean(0)) < 0.001).all()
    assert (pitch_and_joints.std(0) < 0.002).all()
    yaw_and_roll = found[begun][:, [2, 5]] / (rover.weight * TRACKS[rover.name])
    assert (abs(yaw_and_roll.mean(0)) < 0.007).all()
    assert (yaw_and_roll.std(0) < 0.006).all()


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The models by wheel of both rovers, for loose sand."""
    folder = tmp_path_factory.mktemp("models")
    for rover, steered in (("four_wheel_rover", []), ("mars_rover", ["--steered", "all"])):
        track = ["--track-width", str(TRACKS[rover])]
        options = ["--rover", rover, "--soil", "loose_sand", *track, *steered]
        assert model_by_wheel([*options, "--out", str(folder)]) == 0
    return folder


@pytest.mark.parametrize("name", ["A_weave_skid", "B_manoeuvre_steered"])
def test_a_turning_log_becomes_a_bag_that_the_estimator_does_not_believe(
    name: str, models: Path, tmp_path: Path
) -> None:
    """Its contact law is another one, so that no c and no tan phi is given."""
    rover = read_log(name).rover
    assert bag.main([name, "--out", str(tmp_path)]) == 0
    model = models / f"{rover.name}_by_wheel.pt"
    replayed = [str(tmp_path / "bag"), "--model", str(model), "--out", str(tmp_path / "replay")]
    assert replay.main(replayed) == 3
    last = json.loads((tmp_path / "replay" / "summary.json").read_text())["bags"][0]
    assert (last["estimates"], last["status"]) == (TIMES, "DISAGREES")
    assert last["outcomes"].get("GATED", 0) > TIMES / 2


@pytest.mark.parametrize("name", ["A_slopes_skid", "B_manoeuvre_steered"])
def test_observations_are_those_that_the_node_makes_of_the_bag(name: str, tmp_path: Path) -> None:
    log = read_log(name)
    assert bag.main([name, "--out", str(tmp_path)]) == 0
    steered = tuple(each in places_of(log.rover).steered for each in log.rover.wheel_names)
    converter = Converter(log.rover, ConversionConfig(), CoreConfig(), steered)
    topics = ["/wheel_slip", "/wheel_sinkage", "/odom", "/joint_states", "/imu"]
    with BagReader(tmp_path / "bag") as reader:
        series = [[reader.decode(each) for each in reader.messages([name])] for name in topics]
    expected = turns.observations_by_wheel(measured_columns(log, 0), log.rover)
    for mine, messages in zip(expected, zip(*series, strict=True), strict=True):
        theirs = converter.convert(mine.stamp_ns, messages).observation
        assert theirs is not None
        if theirs.steering is None:
            theirs = dataclasses.replace(theirs, steering=np.zeros_like(theirs.slip))
        for field in dataclasses.fields(Observation):
            np.testing.assert_allclose(
                getattr(theirs, field.name), getattr(mine, field.name), rtol=1e-5, atol=2e-6
            )


def test_a_line_of_the_table_counts_what_the_estimator_publishes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[Update] = []
    estimator = Estimator.update

    def watched(self: Estimator, observation: Observation) -> Update:
        seen.append(estimator(self, observation))
        return seen[-1]

    monkeypatch.setattr(Estimator, "update", watched)
    monkeypatch.setattr(turns, "SENSORS", turns.SENSORS[:1])
    monkeypatch.setattr(turns, "SOILS", {"constants of SCM": turns.SOILS["constants of SCM"]})
    [line] = turns.lines(["A_across_skid"])
    assert line[:3] == ("four_wheel_rover", "constants of SCM", "all")
    assert line[3:7] == ("1 of 1", "0", "0", "0")
    gone = [each.prediction for each in seen if np.isfinite(each.prediction.innovation)]
    inside = [each.innovation**2 < 3.8415 * each.innovation_variance for each in gone]
    assert line[7] == f"{100.0 * np.mean(inside):.1f} %"


def test_only_wheels_that_the_model_takes_as_steered_are_steered() -> None:
    for name, some in (("A_weave_skid", False), ("A_weave_steered", True)):
        log = read_log(name)
        steered = _wheels(log, "steering").abs().amax(0) > 0.0
        known = [each in places_of(log.rover).steered for each in log.rover.wheel_names]
        assert bool(steered.any()) is some
        assert not (steered & ~torch.tensor(known)[list(wheel_order(log.rover))]).any()
