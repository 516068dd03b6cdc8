# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of turns and cross slopes: what it measures is the simulated rover's."""

from pathlib import Path

import numpy as np
import pytest

from studies import off_plane
from studies.off_plane import BUMPS, DRIVES, KINDS, SOIL, drives, judge, stops
from studies.physics import physics_model
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.learning import observing
from terrain_estimator.planning.planner import Reason
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.table import TractionTable
from tests.rovers import FOUR_WHEELS

SAMPLES = 25


def test_a_straight_drive_is_taken_and_a_turn_or_a_lean_refused(tmp_path: Path) -> None:
    """600 samples each, one seed: noise is to refuse fewer than one of the straight ones."""
    kind = KINDS[0]
    assert kind.rover == FOUR_WHEELS.name
    model = physics_model(FOUR_WHEELS, [SOIL], tmp_path / "model.pt")
    shares = []
    for yaw_rate, lean in ((0.0, 0.0), (0.4, 0.0), (0.0, 10.0)):
        found, strength = drives(kind, yaw_rate, lean, SAMPLES)
        assert strength.shape == (DRIVES, 2)
        judged = judge(model, found, strength, CoreConfig())
        shares.append(judged.refused)
    straight, turn, slope = shares
    assert straight < 0.02
    assert turn > 0.7  # it begins at rest
    assert slope > 0.9


def test_what_is_measured_of_a_turn_is_noisy_about_the_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """600 readings: their mean is within 4 deviations, their spread within 15 % (5 deviations)."""
    noisy, _ = drives(KINDS[1], 0.02, 0.0, SAMPLES)
    monkeypatch.setattr(observing, "YAW_RATE_SD", 0.0)
    exact, _ = drives(KINDS[1], 0.02, 0.0, SAMPLES)
    pairs = [both for drive in zip(noisy, exact, strict=True) for both in zip(*drive, strict=True)]
    errors = np.array([seen.yaw_rate - true.yaw_rate for seen, true in pairs])
    assert abs(errors.mean()) < 4.0 * 0.003 / np.sqrt(len(errors))
    assert errors.std() == pytest.approx(0.003, rel=0.15)
    assert 0.01 < exact[0][-1].yaw_rate < 0.02  # wheels slip, so it turns more slowly


def test_a_rover_across_a_slope_leans_by_it() -> None:
    found, _ = drives(KINDS[1], 0.0, 6.0, SAMPLES)
    rolls = [each.roll for drive in found for each in drive]
    assert np.mean(rolls) == pytest.approx(np.radians(6.0), abs=4.0 * 0.0053 / np.sqrt(len(rolls)))


def test_on_bumps_contact_angles_and_the_bogie_follow_the_ground() -> None:
    """The middle wheels' ground leads the rear one's: the angles differ from axle to axle."""
    found, _ = drives(KINDS[1], 0.0, 0.0, SAMPLES, BUMPS)
    angles = np.array([[each.contact_angle for each in drive] for drive in found])
    bogie = np.array([[each.bogie_angle for each in drive] for drive in found])
    noise = np.radians(0.3)
    assert angles.std(axis=(0, 1)).min() > 1.5 * noise
    assert np.abs(angles[..., 0] - angles[..., 2]).max() > 10.0 * noise
    assert bogie.std() > 1.5 * noise


def test_the_velocity_of_a_higher_point_is_less_while_the_nose_rises() -> None:
    """Slips and velocity change together: their product is the same hub's."""
    true, _ = drives(KINDS[0], 0.0, 0.0, SAMPLES, BUMPS)
    high, _ = drives(KINDS[0], 0.0, 0.0, SAMPLES, BUMPS, raised=0.3)
    pairs = [both for drive in zip(true, high, strict=True) for both in zip(*drive, strict=True)]
    changes = np.array([seen.velocity - one.velocity for one, seen in pairs])
    slips = np.array([(seen.slip - one.slip) * seen.wheel_rate for one, seen in pairs])
    np.testing.assert_allclose(-slips * FOUR_WHEELS.wheel_radius, changes[:, None] + 0.0 * slips)
    climbs = np.array(
        [d.pitch - c.pitch for drive in true for c, d in zip(drive[:-2], drive[2:], strict=True)]
    )
    middle = changes.reshape(DRIVES, SAMPLES)[:, 1:-1].ravel()
    assert np.corrcoef(climbs, middle)[0, 1] < -0.13  # 552 values: 99.9 % limit of none


def test_a_planner_that_always_stops_is_counted_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The count of stops is the planner's: with the lowest limit of slip it stops nearly all."""
    kind = KINDS[0]
    model = physics_model(FOUR_WHEELS, [SOIL], tmp_path / "model.pt")
    statics = TractionTable(FOUR_WHEELS, solve_statics(FOUR_WHEELS, (SOIL,)))
    found, _ = drives(kind, 0.0, 0.0, SAMPLES)
    assert stops(model, statics, found)[Reason.NONE] == DRIVES
    monkeypatch.setattr(off_plane, "AdviceConfig", lambda: AdviceConfig(slip_limit=0.1))
    assert stops(model, statics, found)[Reason.SLIP] > DRIVES / 2
