# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Forces that depend on the load: beside another contact law, and on single wheels."""

import itertools

import pytest
import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.model.effect_rows import EffectRows
from terrain_estimator.model.effects_by_wheel import EffectsByWheel
from terramechanics.contact.rolling import WheelMotion
from terramechanics.effects import make_effect
from terramechanics.effects.contact import ScmContact
from terramechanics.effects.grousers import LoadedGrousers
from terramechanics.effects.law import Law
from terramechanics.effects.soil import PassiveBulldozing
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.body_plant import WheelEffects
from terramechanics.simulation.plant import ContactInputs, Plant, Situation

SOIL = load_soil("loose_sand")
SIZE = 10.0


def test_the_order_of_lugs_and_another_contact_law_does_not_matter() -> None:
    """In the model and in the simulation; lugs push by the load that the other law gives."""
    rover = load_rover("mars_rover")
    contact = nominal_of(rover, SOIL).contact
    wheels = torch.ones(2, rover.axles, dtype=torch.float64)
    inputs = ContactInputs(0.2 * wheels, 0.015 * wheels, SOIL.constants(), SOIL.strength())
    laws = {"grousers": (LoadedGrousers, [SIZE, 0.0]), "contact_law_scm": (ScmContact, [1.0, 0.0])}
    where = Situation(rover, 0.0, torch.arange(2), 0.0 * wheels, wheels, wheels[:, 0])

    def forces(names: tuple[str, ...]) -> tuple[Tensor, Tensor]:
        rows = EffectRows([laws[name][0](rover) for name in names], rover.mass)
        values = torch.tensor([[v for name in names for v in laws[name][1]]], dtype=torch.float64)
        ruts = rows.ruts(inputs.slip, inputs.sinkage, None, contact)
        known = inputs._replace(rut=ruts)
        plant = Plant([make_effect(name, laws[name][1][0]) for name in names])
        plain = inputs.forces(contact.radius, contact.width, contact.nodes)
        return rows.forces(known, wheels, contact, values), plant.push(where, known, plain)

    one, other = (forces(names) for names in itertools.permutations(laws))
    for first, second in zip(one, other, strict=True):
        torch.testing.assert_close(first, second)
    added = one[0] - forces(("contact_law_scm",))[0]
    assert bool((added[..., 1, :].sum(-1) > 0.0).all())


@pytest.mark.parametrize(
    ("name", "law", "size"),
    [("grousers", LoadedGrousers, 10.0), ("bulldozing", PassiveBulldozing, 1e4)],
)
def test_forces_on_single_wheels_are_those_of_the_simulator_also_backwards(
    name: str, law: type[Law], size: float
) -> None:
    rover = load_rover("four_wheel_rover")
    contact, sides = nominal_of(rover, SOIL).contact, rover.wheels_per_axle
    count = len(rover.wheels)
    rim = torch.tensor([1.0, -1.0, 1.0, -1.0], dtype=torch.float64).repeat(4, 1)
    slip = torch.tensor([[0.3], [-0.3], [0.9], [0.97]], dtype=torch.float64).expand(4, count)
    motion = WheelMotion(rim, (1.0 - slip) * rim, torch.full_like(rim, 0.1))
    sinkage, constants = torch.full_like(rim, 0.015), SOIL.constants().expand(4, count, 6)
    strength = SOIL.strength()

    def modelled(laws: list[Law]) -> Tensor:
        values = torch.tensor([[size, 0.0] * len(laws)], dtype=torch.float64)
        rows = EffectsByWheel(laws, rover)(motion, rim, sinkage, constants, contact, values)
        return rows[..., :2] @ strength + rows[..., 2]

    def simulated(plant: Plant) -> Tensor:
        rate = (rim / rover.wheel_radius).reshape(-1, rover.axles)
        episode = torch.arange(4).repeat_interleave(sides)
        where = Situation(rover, 0.0, episode, 0.0 * rate, rate, rate[:, 0])
        wheels = WheelEffects(plant, where, sides)
        return wheels.forces(motion, sinkage, constants, strength, contact.nodes, 1e-3)

    added = modelled([law(rover)]) - modelled([])
    expected = simulated(Plant([make_effect(name, size)])) - simulated(Plant([]))
    torch.testing.assert_close(added, expected, atol=1e-6, rtol=1e-4)
    ahead = added[..., 1] * rim
    if name == "grousers":
        assert bool((ahead[[0, 2, 3]] > 0.1).all())
        assert bool((ahead[1] < -0.1).all())
    else:  # a braked wheel pushes soil as a driven one does, one that only spins less
        torch.testing.assert_close(ahead[0], ahead[1])
        assert bool((ahead[:3] < -0.1).all())
        torch.testing.assert_close(ahead[3], 0.6 * ahead[0], rtol=1e-3, atol=1e-6)
