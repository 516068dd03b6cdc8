# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of sensors: a correction is the inverse of what is reported; sizes and their values."""

import math

import pytest
import torch

from terramechanics.effects import EFFECTS, describe
from terramechanics.effects.law import Readings
from terramechanics.effects.sensing import Latency
from terramechanics.presets import load_rover

MARS = load_rover("mars_rover")
VALUES = {"slope_bias": [0.02, 0.7], "odometry_scale": [0.06, 0.3], "sinkage_bias": [0.002]}


def readings() -> Readings:
    wheels = torch.tensor([[0.1, 0.2, 0.3], [-0.1, 0.0, 0.4]], dtype=torch.float64)
    return Readings(
        slip=wheels,
        slip_sd=0.01 + 0.0 * wheels,
        sinkage=0.02 + 0.01 * wheels,
        torque=wheels,
        pitch=torch.tensor([[0.1], [-0.2]], dtype=torch.float64),
        acceleration=torch.tensor([[0.4], [-0.7]], dtype=torch.float64),
        wheel_rate=1.0 + wheels,
    )


@pytest.mark.parametrize("name", VALUES)
def test_a_correction_gives_the_true_readings_back(name: str) -> None:
    law, true = describe(name).law(MARS), readings()
    values = torch.tensor([VALUES[name]], dtype=torch.float64)
    seen = law.reported(true, values)
    assert not all(torch.equal(a, b) for a, b in zip(seen[:6], true[:6], strict=True))
    for found, expected in zip(law.corrected(seen, values)[:7], true[:7], strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("name", EFFECTS)
def test_a_size_and_its_value_belong_together(name: str) -> None:
    law, size = EFFECTS[name].law, 0.3 * EFFECTS[name].high
    value = law.value_of(size)
    assert law.size_of(value) == pytest.approx(size, rel=1e-12)
    step = 1e-6 * value
    change = (law.size_of(value + step) - law.size_of(value - step)) / (2.0 * step)
    assert law.slope(value) == pytest.approx(change, rel=1e-6)
    assert EFFECTS[name].values(size).shape == (1, 1 + len(law.extra))


@pytest.mark.parametrize(("share", "felt"), [(0.0, 0.1), (1.0, 0.13), (0.5, 0.115)])
def test_an_accelerometer_may_be_tilted_with_the_attitude_sensor(share: float, felt: float) -> None:
    """A rover that stands on a slope of 0.1 rad; pitch is too large by 0.03 rad."""
    law, slope = describe("slope_bias").law(MARS), torch.tensor([[0.1]], dtype=torch.float64)
    standing = readings()._replace(pitch=slope, acceleration=MARS.gravity * torch.sin(slope))
    seen = law.reported(standing, torch.tensor([[0.03, share]], dtype=torch.float64))
    assert seen.pitch.item() == pytest.approx(0.13)
    assert seen.acceleration.item() == pytest.approx(MARS.gravity * math.sin(felt))


def test_an_unevenly_worn_rover_has_the_size_at_its_middle_axle() -> None:
    law = describe("odometry_scale").law(MARS)
    true, values = readings(), torch.tensor([[0.1, 0.2]], dtype=torch.float64)
    error = torch.tensor([0.08, 0.1, 0.12], dtype=torch.float64)
    expected = (true.slip + error) / (1.0 + error)
    torch.testing.assert_close(law.reported(true, values).slip, expected)


def test_late_readings_are_moved_on_by_their_rates_down_to_the_shallowest() -> None:
    """A reading [s] old; a sinkage never falls below a fifth of what was read."""
    wheels = torch.tensor([[0.1, 0.2, 0.3]], dtype=torch.float64)
    readings = Readings(
        wheels, 0.0 * wheels, 0.1 * wheels, wheels, wheels[:, :1], wheels[:, :1], wheels,
        slip_rate=0.5 * wheels, sinkage_rate=torch.tensor([[0.01, -0.01, -1.0]]).double(),
    )  # fmt: skip
    found = Latency(load_rover("mars_rover")).corrected(readings, torch.tensor([[0.2]]).double())
    torch.testing.assert_close(found.slip, 1.1 * wheels)
    torch.testing.assert_close(
        found.sinkage, torch.tensor([[0.012, 0.018, 0.006]], dtype=torch.float64)
    )
