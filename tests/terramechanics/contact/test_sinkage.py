# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Equilibria of single wheels against scipy's root finder, and their limits."""

import dataclasses

import pytest
import torch
from scipy import optimize
from torch import Tensor

from terramechanics.contact.sinkage import (
    DEEPEST,
    SHALLOWEST,
    WheelGround,
    drawbar_capability,
    equilibrium_sinkage,
    free_rolling,
    slip_under_torque,
)
from terramechanics.presets import load_rover, load_soil, rover_names, soil_names
from terramechanics.terrain.soil import Soil

MARS = load_rover("mars_rover")


def tensor(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def wheel(rover: str, soil: Soil) -> WheelGround:
    return WheelGround.of(load_rover(rover), soil.constants(), soil.strength(), points=12)


@pytest.mark.parametrize("rover", rover_names())
@pytest.mark.parametrize("soil", soil_names())
def test_the_sinkage_carries_the_load(rover: str, soil: str) -> None:
    ground = wheel(rover, load_soil(soil))
    even = load_rover(rover).weight / 6.0
    slip = tensor(-0.4, -0.1, 0.0, 0.1, 0.5, 0.9).repeat(3)
    load = even * tensor(0.2, 1.0, 2.5).repeat_interleave(6)
    sinkage = equilibrium_sinkage(ground, slip, load)
    assert ground.forces(slip, sinkage)[:, 0].tolist() == pytest.approx(load.tolist(), rel=1e-10)
    for index in (0, 4, 9, 17):
        i, target = slip[index], float(load[index])
        expected = optimize.brentq(
            lambda z, i=i, t=target: float(ground.forces(i, tensor(z)[0])[0]) - t,
            1e-7,
            0.05,
            xtol=1e-16,
        )
        assert float(sinkage[index]) == pytest.approx(expected, rel=1e-9)


def test_the_sinkages_are_those_of_the_two_rovers_on_sand() -> None:
    for rover, soil, low, high in (
        ("paper_rover", "loose_sand", 4.5e-3, 5.5e-3),
        ("paper_rover", "compact_sand", 1.2e-4, 1.6e-4),
        ("mars_rover", "loose_sand", 16e-3, 20e-3),
    ):
        load = tensor(load_rover(rover).weight / 6.0)
        assert (
            low
            < float(equilibrium_sinkage(wheel(rover, load_soil(soil)), tensor(0.1), load))
            < high
        )


def test_no_load_gives_no_sinkage_and_too_much_load_the_deepest() -> None:
    ground = wheel("mars_rover", load_soil("loose_sand"))
    sinkage = (
        equilibrium_sinkage(ground, tensor(0.1, 0.1, 0.1), tensor(0.0, -5.0, 1e9))
        / MARS.wheel_radius
    )
    assert sinkage.tolist() == pytest.approx([SHALLOWEST, SHALLOWEST, DEEPEST], rel=1e-9)


def test_on_rigid_ground_the_wheel_does_not_sink_and_rolls_without_resistance() -> None:
    """Stiffer by 10^6: sinkage falls like k^(-1 / (n + 1/2)), and the resistance goes with it."""
    soil = load_soil("loose_sand")
    load = tensor(MARS.weight / 6.0)
    soft, rigid = (
        wheel("mars_rover", soil),
        wheel("mars_rover", soil.with_values(k_phi=1e6 * soil.k_phi)),
    )
    ratio = float(
        equilibrium_sinkage(rigid, tensor(0.0), load) / equilibrium_sinkage(soft, tensor(0.0), load)
    )
    assert ratio == pytest.approx(1e6 ** (-1.0 / (soil.n + 0.5)), rel=0.1)
    slip, sinkage = free_rolling(rigid, load)
    assert 0.0 < float(rigid.forces(slip, sinkage)[0, 2]) < 0.01 * float(load) * MARS.wheel_radius
    slip, sinkage = free_rolling(soft, load)
    assert float(soft.forces(slip, sinkage)[0, 2]) > 0.1 * float(load) * MARS.wheel_radius


def test_slip_under_torque_reproduces_torque_and_load() -> None:
    ground = wheel("mars_rover", load_soil("loose_sand"))
    load = tensor(80.0, 110.0, 140.0)
    torque = ground.forces(
        tensor(0.05, 0.2, 0.6), equilibrium_sinkage(ground, tensor(0.05, 0.2, 0.6), load)
    )[:, 2]
    slip, sinkage = slip_under_torque(ground, torque, load)
    assert slip.tolist() == pytest.approx([0.05, 0.2, 0.6], abs=1e-8)
    assert ground.forces(slip, sinkage)[:, 0].tolist() == pytest.approx(load.tolist(), rel=1e-9)


def test_a_torque_that_the_ground_cannot_take_ends_at_the_end_of_the_range() -> None:
    ground = wheel("mars_rover", load_soil("loose_sand"))
    slip, _ = slip_under_torque(ground, tensor(1e4, -1e4), tensor(110.0, 110.0))
    assert slip.tolist() == pytest.approx([0.95, -0.6])


def test_a_free_rolling_wheel_needs_torque_to_overcome_its_rut() -> None:
    ground = wheel("mars_rover", load_soil("loose_sand"))
    slip, sinkage = free_rolling(ground, tensor(110.0))
    _, traction, torque = ground.forces(slip, sinkage)[0].tolist()
    assert traction == pytest.approx(0.0, abs=1e-6)
    assert torque > 0.0
    assert float(slip) > 0.0


def test_drawbar_capability_grows_with_the_strength_of_the_ground() -> None:
    soil = load_soil("loose_sand")
    strong = dataclasses.replace(soil, cohesion=4000.0, tan_phi=0.9)
    weak = dataclasses.replace(soil, cohesion=0.0, tan_phi=0.2)
    strength = torch.stack([item.strength() for item in (weak, soil, strong)])
    capability = drawbar_capability(MARS, soil.constants().expand(3, 6), strength)
    assert bool((capability.diff() > 0.0).all())
    assert float(capability[0]) < 0.0 < float(capability[1]) < 1.0


def test_drawbar_capability_is_the_largest_of_six_slips() -> None:
    """8 points of quadrature give it to 1e-6: twice as many change it by less."""
    soil = load_soil("loose_sand")
    ground = WheelGround.of(MARS, soil.constants(), soil.strength(), points=16)
    slip = tensor(0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    load = torch.full_like(slip, MARS.weight / len(MARS.wheels))
    normal, traction, _ = ground.forces(slip, equilibrium_sinkage(ground, slip, load)).unbind(-1)
    found = drawbar_capability(MARS, soil.constants()[None], soil.strength()[None])
    assert float(found) == pytest.approx(float((traction / normal).max()), rel=1e-6)


def test_braked_wheels_get_the_same_forces_alone_and_among_many() -> None:
    """Many wheels are treated in two groups, few in one."""
    ground = wheel("mars_rover", load_soil("loose_sand"))
    slip = torch.linspace(-0.5, 0.9, 1000, dtype=torch.float64)
    sinkage = torch.full_like(slip, 0.018)
    alone = torch.cat(
        [
            ground.forces(part, depth)
            for part, depth in zip(slip.reshape(10, 100), sinkage.reshape(10, 100), strict=True)
        ]
    )
    torch.testing.assert_close(ground.forces(slip, sinkage), alone, rtol=1e-6, atol=1e-6)
