# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The worlds of the study of robustness, and its figures."""

import dataclasses

import numpy as np
import pytest
import torch

from studies.robustness import drives
from studies.robustness.drives import Record, drive_batch, excess_of, joined
from studies.robustness.table import line, page
from studies.robustness.worlds import (
    AS_MODELLED,
    SOIL_RANGES,
    TOGETHER,
    VARIATION_M,
    World,
    drift_of,
    measured,
    rover_near,
    together,
    unknown_ground,
    varying_ground,
    worlds,
)
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.messaging.messages import Status
from terrain_estimator.model.loaded import LoadedModel
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import Drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from tests.hidden.generators import GENERATORS

ROVER = load_rover("mars_rover")
DRIVES = 40


def generator(seed: int = 4) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module", name="drive")
def driven() -> Drive:
    ground = Ground.constant(load_soil("loose_sand"))
    return simulate(ROVER, ground, "S1", 4.0, generator(), DRIVES)


def test_every_effect_has_a_world_and_names_are_unique() -> None:
    every = worlds()
    assert len({world.name for world in every}) == len(every)
    assert {name for world in every for name, _ in world.parts} == set(GENERATORS)
    assert not any(world.parts for world in every if world.kind == AS_MODELLED)


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_misstated_noise_is_added_but_not_stated(drive: Drive, factor: float) -> None:
    """The spread of 1600 velocities is within 10 % of what was asked for: 5.6 deviations."""
    found = measured(World("", "", noise=factor), ROVER, drive.sample, generator())
    usual = measured(World("", ""), ROVER, drive.sample, generator())
    error = (found.velocity - drive.sample.velocity) / found.velocity_sd
    assert float(error.std()) == pytest.approx(factor, rel=0.1)
    torch.testing.assert_close(
        torch.as_tensor(found.velocity_sd), torch.as_tensor(usual.velocity_sd)
    )
    assert float((found.slip_sd / usual.slip_sd).nanmedian()) == pytest.approx(1.0, rel=0.05)


def test_noise_is_correlated_over_its_time(drive: Drive) -> None:
    """Neighbours at 0.5 s correlate by 0.82; the estimate of 1560 pairs is within 0.08."""
    found = measured(World("", "", noise_time=0.5), ROVER, drive.sample, generator())
    error = (found.velocity - drive.sample.velocity) / found.velocity_sd
    product = (error[:, 1:] * error[:, :-1]).mean() / error.square().mean()
    assert float(product) == pytest.approx(0.82, abs=0.08)


def test_readings_in_steps_are_whole_numbers_of_them(drive: Drive) -> None:
    found = measured(World("", "", steps=2.0), ROVER, drive.sample, generator())
    steps = found.velocity / 0.02
    torch.testing.assert_close(steps, steps.round(), rtol=0.0, atol=1e-9)
    assert len(set(found.acceleration.flatten().tolist())) > 1000


def test_unknown_soils_lie_in_their_ranges_and_keep_their_strength() -> None:
    strength = torch.tensor([[1000.0, 0.6], [2000.0, 0.7]], dtype=torch.float64)
    [patch] = unknown_ground(strength, generator()).patches
    low, high = torch.tensor(SOIL_RANGES, dtype=torch.float64).unbind(1)
    assert bool(((patch.constants >= low) & (patch.constants <= high)).all())
    assert torch.equal(patch.strength, strength)
    assert not torch.equal(patch.constants[0], patch.constants[1])


def test_varying_ground_deviates_by_its_share_about_the_mean() -> None:
    """The spread of 3000 and more nodes is within 10 % of the share: 7.7 deviations."""
    strength = torch.tensor([[1000.0, 0.6]], dtype=torch.float64).repeat(200, 1)
    constants = load_soil("loose_sand").constants().repeat(200, 1)
    ground = varying_ground(Patch(constants, strength), 0.05, 4.5, generator())
    assert ground.patches[-1].start + VARIATION_M >= 4.5
    factors = [torch.stack([each.strength / strength for each in ground.patches])]
    factors.append(torch.stack([(each.constants / constants)[:, 1:3] for each in ground.patches]))
    for factor in (*factors[0].unbind(2), *factors[1].unbind(2)):
        assert float(factor.mean()) == pytest.approx(1.0, abs=0.005)
        assert float(factor.std()) == pytest.approx(0.05, rel=0.1)
    torch.testing.assert_close(factors[1][..., 0], factors[1][..., 1], rtol=1e-12, atol=0.0)
    kept = torch.stack([each.constants for each in ground.patches])[..., [0, 3, 4, 5]]
    assert torch.equal(kept, constants[:, [0, 3, 4, 5]].expand_as(kept))


def test_a_rover_near_another_differs_by_at_most_thirty_percent_in_three_numbers() -> None:
    rovers = [rover_near(ROVER, generator(seed)) for seed in range(20)]
    for name in ("mass", "wheel_radius", "wheel_width"):
        ratios = [getattr(rover, name) / getattr(ROVER, name) for rover in rovers]
        assert 0.7 <= min(ratios) < 0.85
        assert 1.15 < max(ratios) <= 1.3
    assert (
        dataclasses.replace(
            rovers[0],
            mass=ROVER.mass,
            wheel_radius=ROVER.wheel_radius,
            wheel_width=ROVER.wheel_width,
        )
        == ROVER
    )


def test_a_world_with_everything_hidden_is_drawn() -> None:
    draw = generator()
    found = [together(draw) for _ in range(50)]
    assert {world.kind for world in found} == {TOGETHER}
    assert min(world.noise for world in found) >= 0.5
    assert max(world.noise for world in found) <= 3.0
    assert len({world.parts[0][0] for world in found}) > 8
    assert {world.steps for world in found} == {0.0, 2.0}
    assert all(world.rover and not world.soil for world in found)


def test_an_excess_is_that_of_ten_seconds() -> None:
    assert excess_of([8.0, 10.0], [6.0, 6.0]) == pytest.approx(30.0)
    assert np.isnan(excess_of([], []))


def record(*, status: Status, inside: bool, excess: float = 0.0, count: int = 1) -> Record:
    one = {
        "truth": np.array([1000.0, 0.6]),
        "mean": np.array([1200.0, 0.5]),
        "deviation": np.array([100.0, 0.1]),
        "inside": np.array([1.0, float(inside)]),
        "status": np.array(float(status)),
        "wrong": np.array(0.25),
        "excess": np.array(excess),
        "seconds": np.array(60.0),
    }
    return {name: np.repeat(value[np.newaxis], count, 0) for name, value in one.items()}


def test_a_drive_is_unsound_only_where_it_is_identified_and_wrong() -> None:
    parts = [
        record(status=Status.IDENTIFIED, inside=True),
        record(status=Status.IDENTIFIED, inside=False, excess=30.0),
        record(status=Status.CONVERGING, inside=False, excess=25.0),
        record(status=Status.DISAGREES, inside=True),
    ]
    found = line(World("kind", "name"), joined(parts))
    assert found.sound.value == 0.75
    assert (found.identified, found.disagrees, found.wrong_at) == (0.5, 0.25, 0.25)
    assert found.shift == pytest.approx((2.0, -1.0))
    assert found.visible == 2
    assert found.sound_visible is not None
    assert found.sound_visible.value == 0.5


def test_the_page_judges_a_hundred_drives_by_the_bar() -> None:
    good = record(status=Status.IDENTIFIED, inside=True, excess=30.0, count=100)
    bad = record(status=Status.IDENTIFIED, inside=False, excess=30.0, count=100)
    lines = [
        line(World("kind", "good"), good),
        line(World("kind", "bad"), bad),
        line(World("other", "few"), record(status=Status.IDENTIFIED, inside=True, count=99)),
    ]
    text = page(lines, "Measured.", 7)
    rows = {row.split(" | ")[0]: row for row in text.splitlines() if row.startswith("| ")}
    assert rows["| good"].endswith("| yes |")
    assert rows["| bad"].endswith("| **no** |")
    assert rows["| few"].endswith("| not judged |")
    assert "## Other" in text


def test_a_drift_is_correlated_over_its_time() -> None:
    """At 1 s neighbours correlate by exp(-0.1); 40,000 of them give that within 0.02."""
    series = drift_of((200, 200), 1.0, generator())
    assert float(series.std()) == pytest.approx(1.0, abs=0.06)
    product = (series[:, 1:] * series[:, :-1]).mean() / series.square().mean()
    assert float(product) == pytest.approx(0.905, abs=0.02)


def test_a_drift_is_a_share_of_the_velocity_and_of_what_slip_is_computed_from(
    drive: Drive,
) -> None:
    usual = measured(World("", ""), ROVER, drive.sample, generator())
    only, both = (
        measured(World("", "", drift=0.05, drifting_slip=slip), ROVER, drive.sample, generator())
        for slip in (False, True)
    )
    share = (only.velocity - usual.velocity) / drive.sample.velocity
    assert 0.03 < float(share.std()) < 0.07
    torch.testing.assert_close(both.velocity, only.velocity)
    torch.testing.assert_close(only.slip, usual.slip, equal_nan=True)
    # 1 - slip = v / (r w): both are off by the same share
    of_slip = (usual.slip - both.slip) / (1.0 - drive.sample.slip)
    assert float((of_slip - share.unsqueeze(-1)).nan_to_num().abs().max()) < 1e-12


def test_readings_come_at_the_rate_of_the_world_and_are_averaged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(drives, "SECONDS", 4.0)
    slow, usual, fast = (
        drive_batch(World("", "", rate_hz=rate), 2, 5) for rate in (5.0, 10.0, 50.0)
    )
    # ten observations close a second of driving; at 5 Hz they take two
    assert (fast["seconds"] == usual["seconds"]).all()
    assert (slow["seconds"] < usual["seconds"]).all()
    assert (fast["deviation"] < usual["deviation"]).all()


def test_a_rover_near_a_preset_has_its_own_model(monkeypatch: pytest.MonkeyPatch) -> None:
    rovers = []

    class Seen(Estimator):
        def __init__(self, model: LoadedModel, config: CoreConfig) -> None:
            rovers.append(model.rover)
            super().__init__(model, config)

    monkeypatch.setattr(drives, "SECONDS", 2.0)
    monkeypatch.setattr(drives, "Estimator", Seen)
    drive_batch(World("", "", near="mars_rover"), 2, 5)
    assert rovers[0] == rovers[1]
    assert rovers[0].mass != ROVER.mass
    assert rovers[0].mass == pytest.approx(ROVER.mass, rel=0.3)


@pytest.mark.parametrize(
    "world", [World("", "", (("grousers", 1.0),)), World("", "", soil="", rover=True, noise=2.0)]
)
def test_drives_run_through_the_estimator(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drives, "SECONDS", 3.0)
    found, again = (drive_batch(world, 2, 5) for _ in range(2))
    assert found["mean"].shape == (2, 2)
    assert np.isfinite(found["deviation"]).all()
    assert (found["seconds"] >= 1.0).all()
    for name, values in found.items():
        np.testing.assert_array_equal(values, again[name])
