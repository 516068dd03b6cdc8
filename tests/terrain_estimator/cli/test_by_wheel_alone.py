# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rovers whose loads balances do not determine have models by wheel, and none by axle."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from rover_parameters.records import ConfigError
from rover_sim_node.config import SimulatorConfig
from rover_sim_node.run import SimulatedRun
from rover_sim_node.turning_run import TurningRun
from terrain_estimator.cli import find_missing_effect, model_by_wheel, train
from terrain_estimator.compiled.finding import load
from terrain_estimator.compiled.source import answers, recorded_drive
from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packed_observation import packed_size
from terrain_estimator.model.packing import view_of
from terrain_estimator.offline.reference_drives import judge_sensors, reference_drives
from terrain_estimator.planning.messages import advice_message
from terrain_estimator.planning.planner import Planner
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.statics import read_statics, write_statics
from terrain_estimator.planning.table import TractionTable
from terramechanics.presets import load_soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces
from tests.rovers import BY_WHEEL_ALONE, FIXED_ROCKERS, SIX_WHEELS, rover_file
from tests.terrain_estimator.planning.support import FIRM, belief, drive
from tests.turning_drives import turning_observations

SOIL = load_soil("loose_sand")
TRACK = 0.57
every_rover = pytest.mark.parametrize("rover", BY_WHEEL_ALONE, ids=lambda rover: rover.name)


def words_of(rover: Rover) -> str:
    return (
        f"{rover.name}: axle_x has {rover.axles} axles and joints 0: the loads of a model by axle"
        " follow from balances, with 2 joints fewer than axles; make a model by wheel: ros2 run"
        " terrain_estimator model_by_wheel --rover FILE --soil SOIL... --track-width M; simulate"
        " with the parameter steering"
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with the model by wheel of six wheels on a rigid body, and its rover."""
    folder = tmp_path_factory.mktemp("alone")
    rover = rover_file(SIX_WHEELS, folder / "six.yaml")
    given = ["--rover", rover, "--soil", SOIL.name, "--track-width", str(TRACK)]
    assert model_by_wheel.main([*given, "--out", str(folder / "models")]) == 0
    return folder


@every_rover
def test_a_model_by_axle_is_refused_and_nothing_is_written(
    rover: Rover, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = rover_file(rover, tmp_path / "rover.yaml"), tmp_path / "out"
    assert train.main(["--rover", path, "--soil", SOIL.name, "--out", str(out)]) == 2
    assert capsys.readouterr().err == f"train: {words_of(rover)}\n"
    assert not list(out.glob("*"))


@every_rover
def test_the_search_and_the_simulator_refuse_them_by_axle(
    rover: Rover, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rover_file(rover, tmp_path / "rover.yaml")
    bags = [str(tmp_path / name) for name in ("one", "two")]
    given = ["--rover", path, "--out", str(tmp_path / "out")]
    assert find_missing_effect.main([*bags, *given]) == find_missing_effect.WRONG
    assert words_of(rover) in capsys.readouterr().err
    with pytest.raises(ConfigError, match=re.escape(words_of(rover))):
        SimulatedRun(SimulatorConfig(rover=path))


def test_a_model_by_axle_of_fixed_rockers_is_that_of_the_planar_rover(tmp_path: Path) -> None:
    """Where left and right move alike a differential does nothing."""
    path = rover_file(FIXED_ROCKERS, tmp_path / "rover.yaml")
    models = tmp_path / "models"
    out = ["--out", str(models), "--curves", str(models)]
    assert train.main(["--rover", path, "--soil", SOIL.name, *out]) == 0
    model = load_model(str(models / f"{FIXED_ROCKERS.name}-{SOIL.name}.pt"))
    assert model.rover == FIXED_ROCKERS
    assert model.rows[-2:] == ("moment", "bogie_moment")


def test_a_drive_with_skid_steering_tells_the_ground(made: Path) -> None:
    """From rover file to estimate: model, simulator, messages, estimator, sensors that suffice."""
    path = made / "models" / "six_wheel_rover_by_wheel.pt"
    model = load_model(str(path))
    assert model.rover == SIX_WHEELS
    assert not model.balances_sinkage
    with pytest.raises(ConfigError, match=r"use_sinkage: .* needs every sinkage: .* more axles"):
        Estimator(model, CoreConfig(use_sinkage=False))
    assert list(reference_drives(path, model.metadata)) == [SOIL.name]
    _, doubt = judge_sensors(load(str(path), "auto").model, EstimatorConfig(model=str(path)))
    assert doubt == ""
    config = SimulatorConfig(
        rover=str(made / "six.yaml"), steering="skid", track_width=TRACK, schedule="cmd_vel",
        soil=SOIL.name, seed=4,
    )  # fmt: skip
    twists = [(0.2, 0.0), (0.2, 0.4), (0.2, -0.4)] * 2
    observed = turning_observations(model, TurningRun(config), twists, 4.0)
    estimator = Estimator(model, CoreConfig())
    updates = [estimator.update(each) for each in observed]
    used = sum(each.decision.outcome.used for each in updates)
    assert used > 0.95 * len(observed)
    estimate, truth = updates[-1].estimate, np.array([SOIL.cohesion, SOIL.tan_phi])
    deviation = np.sqrt(np.diag(estimate.covariance))
    assert (np.abs(estimate.mean - truth) < 3.0 * deviation).all()
    assert (deviation < 0.3 * np.array(model.metadata.prior_sd)).all()


def test_the_drive_for_a_compiled_core_is_one_of_every_wheel(made: Path) -> None:
    """Straight over hills, by the plant in three dimensions; the model follows it to the truth."""
    model = load_model(str(made / "models" / "six_wheel_rover_by_wheel.pt"))
    drive = recorded_drive(model.metadata)
    assert drive.shape == (70, packed_size(6, by_wheel=True))
    view = view_of(drive, 6)
    assert (view.slip[30:44] < 0.5).all()
    assert len(set(view.sinkage[40].tolist())) == 6
    assert view.contact_angle.abs().max() > 0.02
    answered = answers(model, drive)
    assert torch.isfinite(answered[:, :4]).all()
    c, tan_phi, c_variance, tan_phi_variance, *_ = answered[-1].tolist()
    mean, sd = model.metadata.prior_mean, model.metadata.prior_sd  # the ground is the prior's
    assert abs(1e3 * c - mean[0]) < 3e3 * c_variance**0.5
    assert abs(tan_phi - mean[1]) < 3.0 * tan_phi_variance**0.5 < 1.5 * sd[1]


def test_the_planner_knows_its_margins_and_says_that_it_leaves_out_the_front_wheels(
    tmp_path: Path,
) -> None:
    steered = WheelPlaces.of(SIX_WHEELS, TRACK, SIX_WHEELS.wheel_names)
    statics = solve_statics(SIX_WHEELS, (SOIL,), steered)
    write_statics(tmp_path / "six.npz", statics, "a" * 64)
    table = TractionTable(SIX_WHEELS, read_statics(tmp_path / "six.npz", "a" * 64), 0.5 * TRACK)
    assert not table.knows_loads
    assert not table.knows_turns
    planner = Planner(table, (2750.0, 0.6), (1300.0, 0.22), AdviceConfig())
    for each in drive()[0][:60]:
        planner.observe(each)
    planner.believe(belief(FIRM))
    found = planner.advise(drive()[0][59].stamp_ns)
    assert found is not None
    assert found.known
    assert math.isnan(found.front_stall_probability)
    assert found.margins.available.median > 0.2 * SIX_WHEELS.weight
    said = advice_message(found, lambda _, **fields: fields, 0, Estimate())["status_text"]
    assert "front wheels not judged: no load of the front wheels from balances" in said


@dataclasses.dataclass
class Estimate:
    """What advice takes of a terrain_estimate."""

    header: None = None
    sequence: int = 0
    effect: tuple[str, ...] = ()


def test_statics_of_a_model_by_axle_are_refused() -> None:
    with pytest.raises(ConfigError, match=re.escape(words_of(SIX_WHEELS))):
        solve_statics(SIX_WHEELS, (SOIL,))
