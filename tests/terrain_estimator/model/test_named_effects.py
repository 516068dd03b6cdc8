# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Models with named effects: their rows, what they estimate, their files, and what they refuse."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.adding import Sized, add_effects, with_effects
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.tasks import measure_tasks
from terrain_estimator.model.effects import LAWS, NOT_ONLINE
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import AddedEffect, ModelFileError
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packed_observation import TIMING, pack, packed_size
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_with_effects import PhysicsWithEffects
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.torchscript import torchscript_model
from terrain_estimator.observation import Observation
from terrain_estimator.update import Estimate, Update
from terramechanics.effects import EFFECTS, describe, make_effect
from terramechanics.effects.simulated import SimulatedEffect
from terramechanics.effects.soil import USUAL_COHESION, USUAL_FRICTION
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import Drive
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground

SIZES = {
    "slope_bias": 0.02,
    "bulldozing": 2e4,
    "drive_drag": 2.0,
    "coulomb_drag": 1.5,
    "payload": 40.0,
    "grousers": 60.0,
    "slip_sinkage": 0.5,
    "multipass": 1.0,
    "odometry_scale": 0.06,
    "sinkage_bias": 0.004,
    "rate_dependence": 0.3,
    "exit_angle": 0.2,
}
TILT = SIZES["slope_bias"]
REPORT = (
    "forecast",
    "forecast_variance",
    "innovation",
    "innovation_variance",
    "misfit",
    "degrees",
    "closed",
    "changed",
    "usable",
)
"""Parts of the state that the estimator reads after each observation."""


@pytest.fixture(scope="module")
def plain() -> LoadedModel:
    return load_model()


def driven(model: LoadedModel, name: str, size: float, seconds: float, seed: int = 3) -> Drive:
    """Return an S1 drive on the model's first soil with the library's law."""
    generator = torch.Generator().manual_seed(seed)
    soil = model.metadata.soils[0]
    if name == "bulldozing":  # in usual soil its law is the model's
        soil = soil.with_values(cohesion=USUAL_COHESION, tan_phi=USUAL_FRICTION)
    ground = Ground.constant(soil)
    return simulate(
        model.rover, ground, "S1", seconds, generator, 1, plant=Plant([make_effect(name, size)])
    )


def measured(drive: Drive, seed: int = 4) -> list[Observation]:
    return observations_of(
        measure_drive(drive.rover, drive.seen, Noise(), torch.Generator().manual_seed(seed)), 0
    )


def in_python(plain: LoadedModel, *effects: Sized) -> LoadedModel:
    """Return the model with effects uncompiled; the compiled one has a test of its own."""
    added = tuple(
        AddedEffect(each.name, describe(each.name).unit, each.mean, each.sd) for each in effects
    )
    module = with_effects(plain, effects)
    metadata = dataclasses.replace(plain.metadata, effects=added)
    return torchscript_model(module, metadata)  # type: ignore[arg-type]


def answered(model: LoadedModel, observations: list[Observation]) -> list[Update]:
    estimator = Estimator(model, CoreConfig())
    return [estimator.update(observation) for observation in observations]


def estimated(model: LoadedModel, observations: list[Observation]) -> Estimate:
    return answered(model, observations)[-1].estimate


def residuals(model: PAlpaca, drive: Drive, size: float) -> torch.Tensor:
    """Return the largest rest of a row of an exact drive, in units of its scale.

    The effect is at ``size`` times the prior mean.
    """
    packed = measure_tasks(drive, Noise(factor=0.0), torch.Generator().manual_seed(0)).measured[0]
    place = packed_size(3) - TIMING
    packed = torch.cat([packed[:, :place], drive.sample.wheel_rate[0], packed[:, place:]], 1)
    theta = torch.cat(
        [drive.sample.strength[0, 0, 0] / model.hypotheses.unit, torch.ones(1, dtype=torch.float64)]
    )
    physics = model.physics
    assert isinstance(physics, PhysicsWithEffects)
    constants = torch.zeros(physics.uncertain_constants, dtype=torch.float64)
    deviations = torch.cat([constants, (size - 1.0) * physics.values.mean / physics.values.sd])
    contact = physics.nominal.nominal_contact(0)
    rows = physics.rows(packed, contact, deviations, theta, model.every_row)
    scale = torch.tensor([3.72, 1.0, *[5.0] * model.axles, 3.72, 1.0, 1.0], dtype=torch.float64)
    assert bool((rows.used > 0.0).all())
    left = rows.target - rows.features[0] @ theta
    left[:, row_names(model.axles).index("velocity")] += drive.sample.acceleration[0]
    return (left / scale).abs().max()


@pytest.mark.parametrize("name", SIZES)
def test_the_rows_of_an_exact_drive_hold_with_the_effect_and_do_not_without_it(
    plain: LoadedModel, name: str
) -> None:
    model = with_effects(plain, [Sized(name, SIZES[name], 0.1 * SIZES[name])])
    drive = driven(plain, name, SIZES[name], 1.5)
    assert float(residuals(model, drive, 1.0)) < 2e-4
    assert float(residuals(model, drive, 0.0)) > 2e-3


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_tilted_sensor_is_estimated_and_no_longer_spoils_the_ground(
    plain: LoadedModel, share: float
) -> None:
    """Without the effect the drive disagrees; its last estimate before that is compared.

    With an accelerometer that has the whole tilt, its row agrees with that of the velocity: after
    20 s the estimate is not confirmed, and no row disagrees yet.
    """
    values = torch.tensor([[TILT, share]], dtype=torch.float64)
    tilted = SimulatedEffect(describe("slope_bias").law, values)
    ground = Ground.constant(plain.metadata.soils[0])
    generator = torch.Generator().manual_seed(3)
    drive = simulate(plain.rover, ground, "S1", 20.0, generator, 1, plant=Plant([tilted]))
    truth = drive.sample.strength[0, 0, 0].numpy()
    observations = measured(drive)
    alone, together = (
        answered(model, observations)
        for model in (plain, in_python(plain, Sized.of_library("slope_bias")))
    )
    assert bool(alone[-1].disagreements) == (share == 0.0)
    assert not any(alone[-1].estimate.identified)
    assert not any(each.disagreements for each in together)
    before = [each.estimate for each in alone if not each.disagreements][-1]
    after = together[-1].estimate
    size = after.effects[0]
    assert (size.name, size.unit) == ("slope_bias", "rad")
    assert abs(size.mean - TILT) < 3.0 * size.sd < TILT
    spread = np.sqrt(np.diagonal(after.covariance))
    assert (np.abs(after.mean - truth) < 3.0 * spread).all()
    assert (np.abs(before.mean - truth) > 2.0 * np.abs(after.mean - truth)).all()


def test_where_nothing_is_missing_the_sizes_of_two_effects_go_to_zero_and_the_ground_stays_known(
    plain: LoadedModel,
) -> None:
    observations = measured(driven(plain, "slope_bias", 0.0, 20.0))
    before = estimated(plain, observations)
    after = estimated(
        in_python(plain, Sized.of_library("slope_bias"), Sized.of_library("exit_angle")),
        observations,
    )
    tilt, rebound = after.effects
    assert abs(tilt.mean) < 3.0 * tilt.sd < TILT
    assert 0.0 <= rebound.mean < 0.05
    assert (np.diagonal(after.covariance) < 2.5 * np.diagonal(before.covariance)).all()
    assert (np.abs(after.mean - before.mean) < 2.0 * np.sqrt(np.diagonal(before.covariance))).all()


def test_the_exported_model_gives_the_numbers_of_the_python_model(
    plain: LoadedModel, tmp_path: Path
) -> None:
    effects = [Sized("payload", 10.0, 5.0), Sized("rate_dependence", 0.0, 0.2)]
    metadata = add_effects(plain, effects, tmp_path / "model.pt")
    loaded, module = load_model(str(tmp_path / "model.pt")), with_effects(plain, effects)
    assert loaded.metadata == metadata
    assert [(each.name, each.unit, each.mean, each.sd) for each in loaded.effects] == [
        ("payload", "kg", 10.0, 5.0),
        ("rate_dependence", "1", 0.0, 0.2),
    ]
    assert metadata.parameters[-8:] == (
        "payload",
        "payload_1",
        "payload_2",
        "rate_dependence",
        "mass",
        "centre_of_mass",
        "acceleration_bias",
        "velocity",
    )
    assert loaded.model_id == f"{plain.model_id}+payload+rate_dependence"
    plainly = torch.jit.optimized_execution(should_optimize=False)  # type: ignore[attr-defined]
    with torch.inference_mode(), plainly:
        here, there = module.initial(), loaded.module.initial()
        for observation in measured(driven(plain, "payload", 10.0, 1.2)):
            packed = torch.from_numpy(
                pack(observation, observation.torque.tolist(), 0.1, linked=True, rates=True)
            )
            here, there = module.update(here, packed), loaded.module.update(there, packed)
        for name in REPORT:
            torch.testing.assert_close(
                there[name], here[name], rtol=1e-9, atol=1e-12, equal_nan=True
            )
        torch.testing.assert_close(
            loaded.module.effects(there), module.effects(here), rtol=1e-9, atol=1e-12
        )


def test_a_wheel_whose_rate_is_not_known_is_left_out(plain: LoadedModel) -> None:
    observation = measured(driven(plain, "slope_bias", 0.0, 1.0))[-1]
    unknown = dataclasses.replace(
        observation, wheel_rate=np.where([True, False, True], observation.wheel_rate, np.nan)
    )
    packed = torch.from_numpy(pack(unknown, unknown.torque.tolist(), 0.1, linked=True, rates=True))
    assert torch.isnan(view_of(packed, 3).slip).tolist() == [False, True, False]
    assert packed.shape[0] == packed_size(3) + 3


def test_every_effect_of_the_registry_can_be_added_or_says_why_not(plain: LoadedModel) -> None:
    assert set(LAWS) | set(NOT_ONLINE) == set(EFFECTS)
    assert not set(LAWS) & set(NOT_ONLINE)
    for name, reason in NOT_ONLINE.items():
        with pytest.raises(
            ConfigError, match=f"effect {name} cannot be added to a model: {reason.split(';')[0]}"
        ):
            with_effects(plain, [Sized.of_library(name)])


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ([], "at least one is needed"),
        ([Sized("payload", 1.0, 1.0)] * 2, "each once"),
        ([Sized("gravity_waves", 1.0, 1.0)], "unknown effect 'gravity_waves'"),
        ([Sized("payload", 1e4, 1.0)], "size 10000 is outside its physical range"),
        ([Sized("payload", 1.0, 0.0)], "standard deviation 0 kg is not a positive number"),
    ],
)
def test_a_wrong_effect_is_refused_by_name(
    plain: LoadedModel, effects: list[Sized], said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        with_effects(plain, effects)


def test_a_model_of_another_version_is_refused_with_what_to_do(plain: LoadedModel) -> None:
    values = plain.module.state_dict()
    values["of_old"] = values.pop("physics.stencil_moves")
    other = SimpleNamespace(state_dict=lambda: values)
    old = dataclasses.replace(plain, module=other)
    with pytest.raises(
        ModelFileError,
        match=(
            f"{plain.model_id} was made by another version.*: the estimator takes it.*train it"
            " again"
        ),
    ):
        with_effects(old, [Sized("payload", 1.0, 1.0)])


def test_effects_are_not_added_to_a_model_that_has_some(plain: LoadedModel) -> None:
    with pytest.raises(ModelFileError, match="give the model that it was made from"):
        restore(in_python(plain, Sized.of_library("payload")))
