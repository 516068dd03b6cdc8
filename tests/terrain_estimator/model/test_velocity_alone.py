# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Models whose velocity row alone counts: their files, what moves them, and what refuses them."""

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from rover_parameters.records import ConfigError
from studies.paper.plants import NARROW, PaperPlant, draw_drives
from terrain_estimator.compiled.core import CompiledModel
from terrain_estimator.compiled.finding import MOST_DIFFERENCE
from terrain_estimator.compiled.folder import build_core, write_core
from terrain_estimator.compiled.runtime import CompiledRuntime
from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.sensor_information import SensorBounds, doubt_of
from terrain_estimator.learning.adding import Sized, add_effects
from terrain_estimator.learning.export import check_export, export
from terrain_estimator.learning.finding_model import check_model
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.training import build_model
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import VELOCITY_ALONE, ModelFileError, Training, read_metadata
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.nodes.common.traction import read_traction
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground
from terramechanics.vehicle.rover import Rover
from tests.terrain_estimator.compiled.built_cores import needs_core

EXAMPLES = Path(__file__).parents[3] / "docs/examples/closed_form"
SOIL, LINEAR = load_soil("loose_sand"), load_soil(str(EXAMPLES / "linear_stress_loose_sand.yaml"))
MARS, THREE_WHEELS = load_rover("mars_rover"), load_rover(str(EXAMPLES / "rover.yaml"))
EXACT = dataclasses.replace(DEFAULT_PRIOR, constants_sd=0.0)
NOTHING_TRAINED = Training(0, 0, 0.0, torch.__version__)


def made(rover: Rover, path: Path, *, law: str = "wong_reece") -> LoadedModel:
    """Write the model of a rover to ``path``, and load it."""
    soil = SOIL if law == "wong_reece" else LINEAR
    model = build_model(rover, [soil], prior=EXACT, used_rows=VELOCITY_ALONE)
    export(model, rover, [soil], NOTHING_TRAINED, path)
    return load_model(str(path))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    return made(MARS, tmp_path_factory.mktemp("mars") / "mars.pt")


@pytest.fixture(scope="module")
def linear(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    path = tmp_path_factory.mktemp("linear") / "linear.pt"
    return made(THREE_WHEELS, path, law="linear_stress")


@pytest.fixture(scope="module")
def drive() -> list[Observation]:
    """Return 20 s over hills with every sensor."""
    generator = torch.Generator().manual_seed(5)
    driven = simulate(MARS, Ground.constant(SOIL), "S1", 20.0, generator, 1)
    return observations_of(measure_drive(MARS, driven.seen, Noise(), generator), 0)


def last(model: LoadedModel, drive: list[Observation], config: CoreConfig | None = None) -> Update:
    """Return the last update of an estimator on a drive."""
    estimator = Estimator(model, config or CoreConfig())
    return [estimator.update(each) for each in drive][-1]


def closed_form(count: int) -> tuple[list[list[Observation]], Floats]:
    """Return drives of the paper's closed form, and the truths [n, 2]."""
    generator = torch.Generator().manual_seed(11)
    rover, nothing = load_rover("paper_rover"), math.nan
    plant = PaperPlant.CLOSED_FORM
    drives = draw_drives(plant, rover, SOIL, NARROW, 40.0, count, generator).drives
    level, absent = np.zeros(3), np.full(3, nothing)
    observations = [
        [
            Observation(
                stamp_ns=(step + 1) * 100_000_000,
                slip=drives.slip[index, step].numpy(),
                slip_sd=np.maximum(drives.slip_sd[index, step].numpy(), 1e-9),
                sinkage=drives.sinkage[index, step].numpy(),
                sinkage_sd=drives.sinkage_sd[index, step].numpy(),
                contact_angle=level,
                contact_angle_sd=level + 1e-5,
                wheel_rate=absent,
                torque=absent,
                torque_sd=absent,
                velocity=float(drives.velocity[index, step + 1]),
                velocity_sd=0.01,
                pitch=0.0,
                pitch_sd=1e-5,
                acceleration=nothing,
                acceleration_sd=nothing,
                bogie_angle=nothing,
                roll=0.0,
                roll_sd=0.01,
                lateral_velocity=0.0,
                lateral_velocity_sd=0.01,
                yaw_rate=0.0,
                yaw_rate_sd=0.01,
                steering=level,
            )
            for step in range(drives.slip.shape[1])
        ]
        for index in range(count)
    ]
    return observations, drives.strength.numpy()


def test_the_velocity_row_alone_counts(model: LoadedModel, drive: list[Observation]) -> None:
    assert model.used_rows == ("velocity",)
    assert model.rows == load_model("mars_rover").rows
    assert usable_rows(model.used_rows, CoreConfig()) == ("velocity",)
    update = last(model, drive)
    assert update.decision.rows_used == ("velocity",)
    assert {each.row for each in update.estimate.fit} == {"velocity"}
    assert restore(model).every_row.tolist() == [1.0] + [0.0] * (len(model.rows) - 1)


def test_a_description_with_other_rows_is_refused(tmp_path: Path) -> None:
    made(MARS, tmp_path / "mars.pt")
    file = tmp_path / "mars.json"
    content = json.loads(file.read_text())
    assert content["used_rows"] == ["velocity"]
    assert read_metadata(file).used_rows == VELOCITY_ALONE
    file.write_text(json.dumps(content | {"used_rows": ["load"]}))
    with pytest.raises(ModelFileError, match="used_rows 'load': give velocity, or leave it out"):
        read_metadata(file)


def heavier(observation: Observation) -> Observation:
    """Return what other loads, torques and moments would have made of everything but the row."""
    return dataclasses.replace(
        observation,
        torque=3.0 * observation.torque,
        acceleration=observation.acceleration + 0.7,
        bogie_angle=observation.bogie_angle + 0.2,
    )


def test_other_sensors_change_no_bit(model: LoadedModel, drive: list[Observation]) -> None:
    one, other = last(model, drive), last(model, [heavier(each) for each in drive])
    assert np.array_equal(one.estimate.mean, other.estimate.mean)
    assert np.array_equal(one.estimate.covariance, other.estimate.covariance)
    every = load_model("mars_rover")
    moved = last(every, [heavier(each) for each in drive]).decision
    assert moved != last(every, drive).decision


def test_the_load_does_not_move_the_posterior(tmp_path: Path, drive: list[Observation]) -> None:
    """Twice the gravity on level ground doubles the load row's target, and is not in the other."""
    level = [dataclasses.replace(each, pitch=0.0, pitch_sd=1e-9) for each in drive]
    twice = dataclasses.replace(MARS, gravity=2.0 * MARS.gravity)
    means: list[Floats] = []
    for used in (VELOCITY_ALONE, ()):
        for rover in (MARS, twice):
            path = tmp_path / f"{len(means)}.pt"
            built = build_model(rover, [SOIL], prior=EXACT, used_rows=used)
            export(built, rover, [SOIL], NOTHING_TRAINED, path)
            runtime = load_model(str(path))
            estimator = Estimator(runtime, CoreConfig(gate_probability=0.0))
            for each in level:
                estimator.update(each)
            means.append(runtime.runtime.estimate(estimator._state)[0])
    assert means[0] == pytest.approx(means[1], rel=1e-6)
    assert abs(means[2][0] - means[3][0]) > 100.0


def test_data_that_no_balance_made_give_c_and_tan_phi(linear: LoadedModel) -> None:
    observations, truths = closed_form(4)
    updates = [last(linear, each) for each in observations]
    errors = np.array([each.estimate.mean for each in updates]) / truths - 1.0
    assert (np.median(abs(errors), 0) < (0.08, 0.04)).all()
    for update, true in zip(updates, truths, strict=True):
        sd = np.sqrt(np.diag(update.estimate.covariance))
        assert (abs(update.estimate.mean - true) < 4.0 * sd).all()
        assert update.estimate.identified == (False, False)
        assert "the velocity alone tells neither" in update.unconfirmed
        assert not update.disagreements


def test_a_missing_sinkage_is_refused(model: LoadedModel, drive: list[Observation]) -> None:
    missing = dataclasses.replace(drive[0], sinkage=np.full(3, math.nan))
    assert Estimator(model, CoreConfig()).update(missing).decision.outcome is Outcome.NOT_FINITE
    with pytest.raises(ConfigError, match=r"use_sinkage.*velocity row alone: set it to true"):
        Estimator(model, CoreConfig(use_sinkage=False))


@needs_core
@pytest.mark.parametrize("law", ["wong_reece", "linear_stress"])
def test_the_compiled_core_and_torchscript_give_the_same(
    law: str, tmp_path: Path, drive: list[Observation]
) -> None:
    rover = MARS if law == "wong_reece" else THREE_WHEELS
    loaded = made(rover, tmp_path / "own.pt", law=law)
    seen = drive if law == "wong_reece" else closed_form(1)[0][0]
    write_core(tmp_path / "own.pt", tmp_path / "core")
    build_core(tmp_path / "core", tmp_path / "own.so", "-O0")
    core = CompiledModel(tmp_path / "own.so")
    assert core.difference() <= MOST_DIFFERENCE
    compiled = dataclasses.replace(loaded, runtime=CompiledRuntime(core))
    one, other = last(loaded, seen), last(compiled, seen)
    sd = np.sqrt(np.diag(one.estimate.covariance))
    assert (abs(one.estimate.mean - other.estimate.mean) <= MOST_DIFFERENCE * sd).all()
    assert other.estimate.covariance == pytest.approx(one.estimate.covariance, rel=1e-8)
    assert one.decision.rows_used == other.decision.rows_used == ("velocity",)


def test_the_file_gives_the_numbers_of_the_python_model(tmp_path: Path) -> None:
    model = build_model(THREE_WHEELS, [LINEAR], prior=EXACT, used_rows=VELOCITY_ALONE)
    export(model, THREE_WHEELS, [LINEAR], NOTHING_TRAINED, tmp_path / "own.pt")
    rows = torch.rand(20, model.observation_size, generator=torch.Generator().manual_seed(0))
    check_export(model, tmp_path / "own.pt", rows.to(torch.float64) * 0.1)


REFUSALS: tuple[tuple[Callable[[Path], object], str], ...] = (
    (lambda path: add_effects(load_model(str(path)), [Sized("payload", 0.0, 5.0)], path), "effect"),
    (lambda path: check_model(str(path), MARS), "the search compares all rows"),
    (lambda path: read_traction(str(path), ""), "traction is forecast from the balances"),
)


@pytest.mark.parametrize(("call", "why"), REFUSALS)
def test_what_needs_other_rows_refuses_the_model_by_name(
    tmp_path: Path, call: Callable[[Path], object], why: str
) -> None:
    made(MARS, tmp_path / "mars.pt")
    words = rf"model mars-\d+ uses the velocity row alone \(train --rows velocity\): .*{why}"
    with pytest.raises((ConfigError, ModelFileError), match=words):
        call(tmp_path / "mars.pt")


def test_effects_are_not_known_for_linear_stresses(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="law linear_stress: the search for effects knows"):
        nominal_of(THREE_WHEELS, LINEAR)
    export(
        build_model(THREE_WHEELS, [LINEAR], prior=EXACT),
        THREE_WHEELS,
        [LINEAR],
        NOTHING_TRAINED,
        tmp_path / "all.pt",
    )
    with pytest.raises(ConfigError, match="law linear_stress: named effects are known for"):
        add_effects(
            load_model(str(tmp_path / "all.pt")), [Sized("payload", 0.0, 5.0)], tmp_path / "m.pt"
        )


def test_a_reference_drive_warns_of_what_the_velocity_alone_leaves_to_the_prior() -> None:
    poor = SensorBounds({"loose_sand": math.inf}, 40.0)
    assert "data with other slips and sinkages may tell more: in a reference drive" in doubt_of(
        poor, EstimatorConfig(), velocity_alone=True
    )
    assert not doubt_of(
        SensorBounds({"loose_sand": 0.5}, 40.0), EstimatorConfig(), velocity_alone=True
    )
