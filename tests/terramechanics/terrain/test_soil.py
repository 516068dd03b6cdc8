# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A soil carries wheels of some widths, whatever the sign of its cohesive modulus."""

import pytest
import torch

from rover_parameters.records import ConfigError
from terramechanics.contact.stresses import quadrature
from terramechanics.presets import load_soil
from terramechanics.simulation.plant import ContactInputs

SOIL = load_soil("loose_sand")
WIDTH = 0.16


def test_a_negative_cohesive_modulus_gives_the_forces_of_the_same_stiffness() -> None:
    """Only k_c / b + k_phi enters."""
    negative = SOIL.with_values(k_c=-5000.0, k_phi=SOIL.k_phi + (SOIL.k_c + 5000.0) / WIDTH)
    slip, sinkage = torch.tensor([[0.2]]).double(), torch.tensor([[0.02]]).double()
    forces = [
        ContactInputs(slip, sinkage, soil.constants(), soil.strength()).forces(
            0.13, WIDTH, quadrature()
        )
        for soil in (SOIL, negative.for_wheel(WIDTH))
    ]
    torch.testing.assert_close(*forces)


def test_a_soil_that_carries_no_wheel_of_this_width_is_refused() -> None:
    soft = SOIL.with_values(k_c=-SOIL.k_phi * WIDTH)
    with pytest.raises(ConfigError, match=r"loose_sand: k_c / b \+ k_phi is 0 Pa/m\^n for wheels"):
        soft.for_wheel(WIDTH)
    assert soft.for_wheel(2.0 * WIDTH) is soft
