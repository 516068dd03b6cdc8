# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of a model by wheel: what it measures, and its bound."""

import re

import numpy as np
import pytest
import torch

from studies import lateral, off_plane
from studies.by_wheel import added, bound
from studies.by_wheel import motions as motions_module
from studies.by_wheel.bound import (
    BOUND_HEAD,
    MOTION_BOUND_HEAD,
    SKID,
    Known,
    bound_lines,
    information,
    motion_bound_lines,
    standing,
)
from studies.by_wheel.motions import HEAD, Motion, lines, motions
from studies.by_wheel.stops import STOP_HEAD, by_axle, stop_lines
from studies.off_plane import KINDS
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.physics import UNCERTAIN
from terramechanics.presets import load_rover
from terramechanics.simulation.sensors import Noise
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.wheel_places import wheel_order
from tests.hidden.sensing import Sensed
from tests.turning_hidden import SKID as TURNING_SKID
from tests.turning_hidden import STEERED, Turning, driven


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the drives beside the bound be three of 4 s."""
    monkeypatch.setattr(lateral, "DRIVES", 3)
    monkeypatch.setattr(lateral, "SAMPLES", 40)


def test_a_line_counts_the_drives_of_its_motion() -> None:
    turn = Motion("a turn", yaw_rate=0.4, roll_sd=0.01)
    motions = [turn, turn.but("no sinkages", sinkages=False), turn.but("torques", gain_sd=0.1)]
    for motion, line in zip(motions, lines(KINDS[0], motions, drives=2, samples=30), strict=True):
        words, used, *_, held, _, wrong = line
        assert len(HEAD) == len(line)
        assert words == motion.words
        assert float(used.rstrip(" %")) > 90.0
        assert held.endswith(" of 2")
        assert wrong == "0"


def test_the_stops_of_turns_are_counted_by_the_slip_of_the_outer_wheels() -> None:
    (line,) = stop_lines(drives=2, samples=60, yaw_rates=[0.6])
    assert len(line) == len(STOP_HEAD)
    *_, known, above, below, others = line
    assert others == "0 of 2"
    assert known.endswith(" of 2")
    assert sum(int(each.split(" of ")[1]) for each in (above, below)) == 2


def test_the_planner_takes_the_means_of_an_axle() -> None:
    samples, _ = lateral.drive(0.6)
    (found, *_), *_ = observed(SKID, samples, range(4), torch.Generator().manual_seed(1))
    axles = by_axle(found, [0, 0, 1, 1])
    np.testing.assert_allclose(axles.slip, found.slip.reshape(2, 2).mean(1))
    assert axles.velocity == found.velocity
    assert axles.steering is None


def test_the_constant_errors_of_a_drive_are_those_of_its_motion() -> None:
    samples, _ = lateral.drive(0.6)
    found = observed(SKID, samples, range(4), torch.Generator().manual_seed(1))[0]
    motion = Motion("", roll_sd=0.5, gain_sd=0.25)
    changed = motion.misread(found, torch.Generator().manual_seed(2))
    bias, gain = torch.randn(2, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    for each, other in zip(found, changed, strict=True):
        assert other.roll - each.roll == pytest.approx(0.5 * float(bias), abs=1e-12)
        assert other.torque == pytest.approx(each.torque * (1.0 + 0.25 * float(gain)))
    assert Motion("").misread(found, torch.Generator())[3].roll == found[3].roll


def test_a_table_has_each_motion_once() -> None:
    for kind in KINDS:
        words = [each.words for each in motions(kind.rover)]
        assert len(set(words)) == len(words)
        assert "straight, level, no sinkages" in words


def test_every_wheel_is_measured_about_its_own_truth() -> None:
    """3 drives of 40 samples: 480 slips, whose errors are within 5 of their deviations."""
    assert wheel_order(SKID) == (0, 1, 2, 3)
    samples, _ = lateral.drive(0.6)
    found = observed(SKID, samples, range(4), torch.Generator().manual_seed(1))
    true = torch.stack([sample.slip for sample in samples], 1).numpy()
    for drive, observations in enumerate(found):
        for step, each in enumerate(observations):
            error = (each.slip - true[drive, step]) / each.slip_sd
            assert np.abs(error).max() < 5.0
    spread = np.ptp([each.slip for each in found[0][10:]], axis=1)
    assert spread.max() > 0.1  # the sides differ in a turn


def test_more_that_is_unknown_widens_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    samples, strength = lateral.drive(0.6)
    matrices = [information(sample, strength) for sample in samples]
    rows = tuple(range(10))
    known, unknown = (
        lateral.bound(matrices, rows, (*lateral.PRIOR_SD, *deviations))[:, :2]
        for deviations in ((1e-9,) * 4, (0.01, 0.02, 0.02, 0.01))
    )
    assert (unknown >= known).all()
    assert (unknown[:, 0] > 1.01 * known[:, 0]).any()
    monkeypatch.setattr(bound, "TURNING", (0.6,))
    ((turning, *found),) = bound_lines(drives=2)
    assert turning == "to 0.6 rad/s"
    assert len(found) == len(BOUND_HEAD) - 1
    assert all(float(value) > 0.8 for value in found[2].split(" / "))


def test_the_bound_counts_the_noise_of_contact_angles(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a plane the force ahead of a wheel changes by its load per rad."""
    samples, strength = lateral.drive(0.6)
    _, noisy, _ = information(samples[-1], strength)
    sd = Noise().contact_angle
    monkeypatch.setattr(bound, "Noise", lambda: Noise(contact_angle=0.0))
    _, exact, _ = information(samples[-1], strength)
    load = samples[-1].forces[..., 0]
    expected = (load**2).sum(-1) * sd**2
    torch.testing.assert_close((noisy - exact)[:, 0, 0], expected, rtol=0.01, atol=0.0)


def test_wheels_of_the_bound_stand_at_their_contact_angles() -> None:
    rover = load_rover("mars_rover")
    chassis = Chassis.of(rover, 1.0, 20.0)
    generator = torch.Generator().manual_seed(4)
    angle, steering = 0.2 * torch.randn(2, 3, 6, generator=generator, dtype=torch.float64)
    joints = 0.1 * torch.randn(3, 3, generator=generator, dtype=torch.float64)
    stance = standing(chassis, steering, joints, angle)
    torch.testing.assert_close(stance.contact_angle(steering), angle)
    _, left, up, _ = stance.axes(steering)
    torch.testing.assert_close(left[..., 2], torch.zeros_like(angle))
    torch.testing.assert_close(up.norm(dim=-1), torch.ones_like(angle))
    flat = standing(chassis, steering, 0.0 * joints, 0.0 * angle)
    level = chassis.balance_matrix(steering)
    torch.testing.assert_close(chassis.balance_matrix(steering, flat), level)


def test_each_ground_has_a_bound_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three drives of 4 s of steered wheels: turns stand beside straight drives on that ground."""
    for module in (motions_module, off_plane):
        monkeypatch.setattr(module, "DRIVES", 3)
    found = list(motion_bound_lines(KINDS[1], samples=40))
    assert all(len(line) == len(MOTION_BOUND_HEAD) for line in found)
    words = [line[0] for line in found]
    turn = "0.05 rad/s commanded"
    grounds = ("", ", hills of 5°", ", bumps of 5°")
    assert words == [f"{start}{end}" for start in ("straight, level", turn) for end in grounds]
    values = [[float(value.rstrip(" %")) for value in line[1].split(" / ")] for line in found]
    for (_, _, over), straight, turning in zip(found[3:], values, values[3:], strict=False):
        expected = np.divide(turning, straight)
        stated = [float(value) for value in over.split(" / ")]
        np.testing.assert_allclose(stated, expected, rtol=0.02)
    assert all(line[2] == "" for line in found[:3])
    assert len({line[1] for line in found}) == 6


def test_unknown_soil_constants_widen_the_bound() -> None:
    samples, strength = lateral.drive(0.3)
    rows, prior = tuple(range(10)), (*lateral.PRIOR_SD, 0.01, 0.02, 0.02, 0.01)
    exact, unknown = (
        lateral.bound([information(sample, strength, known) for sample in samples], rows, sds)
        for known, sds in (
            (Known(), prior),
            (Known(constants_sd=0.03), (*prior, *(1.0,) * len(UNCERTAIN))),
        )
    )
    assert (unknown[:, :2] >= exact[:, :2]).all()
    assert (unknown[:, 0] > 1.01 * exact[:, 0]).any()


@pytest.mark.parametrize(
    ("turning", "name", "own", "law"),
    [
        (TURNING_SKID, "sinkage_bias", False, "rim angle read wrong"),
        (TURNING_SKID, "sinkage_bias", True, "the library's"),
        (TURNING_SKID, "odometry_scale", False, "the library's"),
        (STEERED, "odometry_scale", False, "wheels worn unevenly"),
    ],
)
def test_a_line_compares_the_models_with_and_without_the_effect(
    turning: Turning, name: str, *, own: bool, law: str
) -> None:
    (line,) = added.lines(turning, [name], drives=2, seconds=4.0, own=own)
    assert len(line) == len(added.HEAD)
    assert line[:2] == (f"`{name}`", law)
    assert re.fullmatch("[012] / [012]", line[3])
    assert line[2] != line[5]


def test_a_sensor_of_each_drive_is_wrong_by_its_own_size() -> None:
    generator = torch.Generator().manual_seed(3)
    tilted, law = added.hidden("slope_bias", TURNING_SKID.rover, 2, generator)
    assert isinstance(tilted, Sensed)
    samples, _, _ = driven(TURNING_SKID, tilted, 2, 20.0, generator)
    true = torch.stack([sample.pitch for sample in samples], 1).numpy()
    found, _, found_law = added.found(TURNING_SKID, "slope_bias", 3, 2, 20.0)
    assert law == found_law == "inertial unit tilted, less while cold"
    for drive, size in enumerate(tilted.sizes.tolist()):
        read = np.array([each.pitch for each in found[drive]])
        error = np.mean(read[150:] - true[drive, 150:])  # when the unit is nearly warm
        assert error == pytest.approx(0.9 * size, abs=0.15 * abs(size))
