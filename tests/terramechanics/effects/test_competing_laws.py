# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Formulas of laws that compete for a name, by hand."""

import math

import pytest
import torch

from terramechanics.effects.lugs import PassivePressure
from terramechanics.effects.soil import SinkageFactor
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")


def one_wheel(slip: float, sinkage: float, tan_phi: float = 0.6) -> ContactInputs:
    """Return the inputs of each axle of the rover, all alike, on loose sand."""
    ones = torch.ones(1, ROVER.axles, dtype=torch.float64)
    strength = torch.tensor([800.0, tan_phi], dtype=torch.float64).expand(1, ROVER.axles, 2)
    constants = SOIL.constants().expand(1, ROVER.axles, 6)
    return ContactInputs(slip * ones, sinkage * ones, constants, strength)


def test_lugs_push_with_rankine_s_passive_pressure() -> None:
    """At 30 degrees N = tan^2(60 deg) = 3 and 1 kPa holds; at slip 0.1 it is 1 - 1/e of that."""
    radius, width, sinkage = ROVER.wheel_radius, ROVER.wheel_width, 0.02
    law = PassivePressure(ROVER)
    values = torch.tensor([[1000.0, 0.0]], dtype=torch.float64)
    area = width * radius * math.acos(1.0 - sinkage / radius)
    for slip, angle, coefficient in ((0.1, 30.0, 1.0), (-0.1, 30.0, 1.0), (0.1, 0.0, 1.0 / 3.0)):
        tan_phi = math.tan(math.radians(angle))
        force = law.added_force(one_wheel(slip, sinkage, tan_phi), values)
        assert force is not None
        wanted = math.copysign(1000.0 * coefficient * area * (1.0 - math.exp(-1.0)), slip)
        assert force.traction[0].tolist() == pytest.approx([wanted] * ROVER.axles)
        assert force.torque[0].tolist() == pytest.approx([radius * wanted] * ROVER.axles)


def test_a_wheel_sinks_by_lyasko_s_factor_at_the_same_pressure() -> None:
    """At slip 0.2 it is 1.2 / 0.9: k (z 4/3)^n with the softer k is k z^n with the other."""
    inputs = one_wheel(0.2, 0.02)
    changed = SinkageFactor(ROVER).contact(
        inputs, torch.ones(1, 1, dtype=torch.float64), torch.zeros(1, ROVER.axles)
    )
    before, after = inputs.constants[0, 0], changed.constants[0, 0]
    exponent = float(before[0])
    for k in (1, 2):  # k_c and k_phi
        pressure = float(after[k]) * (0.02 * 4.0 / 3.0) ** exponent
        assert pressure == pytest.approx(float(before[k]) * 0.02**exponent)
    assert torch.equal(after[3:], before[3:])
