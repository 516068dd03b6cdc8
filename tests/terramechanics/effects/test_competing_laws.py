# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Formulas of laws that compete for a name, by hand."""

import math

import pytest
import torch

from terramechanics.contact.stresses import quadrature
from terramechanics.effects import EFFECTS, Competing
from terramechanics.effects.depth import ExitByEntry, SinkageGrowth
from terramechanics.effects.law import AddedForce, Law
from terramechanics.effects.loaded_lugs import LugSides, SpacedLugs
from terramechanics.effects.lugs import PassivePressure
from terramechanics.effects.soil import SinkageFactor, side_resistance
from terramechanics.effects.wedges import (
    UNIT_WEIGHT,
    BekkerWedge,
    HegedusSide,
    HegedusWedge,
    wedge_factors,
)
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
RADIUS, WIDTH = ROVER.wheel_radius, ROVER.wheel_width
COHESION = 800.0
EVERY = [each for effect in EFFECTS.values() for each in effect.competing]
STILL = torch.zeros(1, ROVER.axles, dtype=torch.float64)


def one_wheel(
    slip: float, sinkage: float, tan_phi: float = 0.6, cohesion: float = COHESION
) -> ContactInputs:
    """Return the inputs of each axle of the rover, all alike, on loose sand."""
    ones = torch.ones(1, ROVER.axles, dtype=torch.float64)
    strength = torch.tensor([cohesion, tan_phi], dtype=torch.float64).expand(1, ROVER.axles, 2)
    constants = SOIL.constants().expand(1, ROVER.axles, 6)
    return ContactInputs(slip * ones, sinkage * ones, constants, strength)


def values(*row: float) -> torch.Tensor:
    return torch.tensor([row], dtype=torch.float64)


def added(law: Law, inputs: ContactInputs, *row: float) -> AddedForce:
    """Return the force of a law at its values."""
    force = law.added_force(inputs, values(*row))
    assert force is not None
    return force


def first(tensor: torch.Tensor | None) -> float:
    assert tensor is not None
    return float(tensor[0, 0])


@pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
def test_a_competing_law_of_no_size_is_the_nominal_model(law: Competing) -> None:
    acting = law.law(ROVER)
    turned = one_wheel(0.3, 0.02)._replace(slip_angle=torch.full_like(STILL, 0.2))
    none = (0.0,) * acting.count
    changed = acting.contact(turned, values(*none), STILL)
    nodes = quadrature()
    bare, with_it = (each.forces(RADIUS, WIDTH, nodes) for each in (turned, changed))
    assert with_it[0, 0].tolist() == pytest.approx(bare[0, 0].tolist(), rel=1e-9)
    force = acting.added_force(turned, values(*none)) or AddedForce(STILL, STILL)
    parts = (force.traction, force.torque, STILL if force.lateral is None else force.lateral)
    assert [first(each) for each in parts] == pytest.approx([0.0] * 3)


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


def test_a_wheel_sinks_linearly_with_slip_at_the_same_pressure() -> None:
    """At slip -0.25 and a size of 2 it is 1.5 times as deep."""
    inputs = one_wheel(-0.25, 0.02)
    after = SinkageGrowth(ROVER).contact(inputs, values(2.0), STILL).constants[0, 0]
    before = inputs.constants[0, 0]
    pressure = float(after[2]) * 0.03 ** float(before[0])
    assert pressure == pytest.approx(float(before[2]) * 0.02 ** float(before[0]))


@pytest.mark.parametrize(("slip", "share"), [(0.5, 0.3), (0.0, 0.2), (-0.3, 0.2)])
def test_contact_ends_at_a_share_of_the_entry_angle_that_grows_with_slip(
    slip: float, share: float
) -> None:
    inputs = one_wheel(slip, 0.02)
    changed = ExitByEntry(ROVER).contact(inputs, values(0.2, 1.0), STILL)
    assert first(changed.exit_angle) == pytest.approx(share * math.acos(1.0 - 0.02 / RADIUS))


@pytest.mark.parametrize("slip", [0.2, -0.2])
def test_the_sides_of_lugs_shear_the_soil_as_micklethwait_has_it(slip: float) -> None:
    height, length = 0.01, RADIUS * math.acos(1.0 - 0.02 / RADIUS)
    inputs = one_wheel(slip, 0.02)
    load = first(inputs.forces(RADIUS, WIDTH, quadrature())[..., 0])
    rubbed = 0.64 * load * 0.6 * height / WIDTH * math.atan2(WIDTH, height)
    sheared = 0.2 * length / float(SOIL.constants()[3])
    mobilised = 1.0 - (1.0 - math.exp(-sheared)) / sheared
    wanted = math.copysign((2.0 * height * length * COHESION + rubbed) * mobilised, slip)
    force = added(LugSides(ROVER), inputs, height)
    assert first(force.traction) == pytest.approx(wanted, rel=1e-4)  # of four nodes for the load
    assert first(force.torque) == pytest.approx((RADIUS + 0.005) * wanted, rel=1e-4)


def test_each_spaced_lug_has_its_passive_pressure_below_the_load() -> None:
    """At 30 degrees N_phi = 3; one lug of 10 mm in 40 mm of contact is a size of 1/4."""
    sinkage = RADIUS * (1.0 - math.cos(0.04 / RADIUS))
    inputs = one_wheel(1.0, sinkage, math.tan(math.radians(30.0)))
    load = first(inputs.forces(RADIUS, WIDTH, quadrature())[..., 0])
    surcharge = load / (WIDTH * 0.04)
    lug = WIDTH * (3.0 * surcharge * 0.01 + 2.0 * COHESION * 0.01 * math.sqrt(3.0))
    force = added(SpacedLugs(ROVER), inputs, 0.25, 0.0)
    wanted = lug * (1.0 - math.exp(-10.0))
    assert first(force.traction) == pytest.approx(wanted, rel=1e-4)
    assert first(force.torque) == pytest.approx(RADIUS * wanted, rel=1e-4)


def test_a_blade_in_clay_pushes_against_twice_the_cohesion() -> None:
    """Without friction the passive pressure is gamma h + 2 c, that of Hegedus is the same."""
    z = 0.03
    force = added(HegedusWedge(ROVER), one_wheel(0.2, z, 0.0), 1.0, 0.0)
    assert first(force.traction) == pytest.approx(-WIDTH * z * (2.0 * COHESION + UNIT_WEIGHT * z))
    assert first(force.torque) == 0.0


def test_the_blade_s_force_is_that_of_hegedus_s_factors() -> None:
    z, phi = 0.03, math.radians(35.0)
    x = math.radians(45.0) - 0.5 * phi
    d_1 = 1.0 / math.tan(x) + math.tan(x + phi)
    d_2 = 1.0 / math.tan(x) + math.tan(phi) / math.tan(x) ** 2
    wanted = WIDTH * d_1 * (COHESION * z + 0.5 * 1.1 * UNIT_WEIGHT * d_2 * z**2)
    inputs = one_wheel(0.2, z, math.tan(phi))
    force = added(HegedusWedge(ROVER), inputs, 0.5, math.log(1.1))
    assert first(force.traction) == pytest.approx(-0.5 * wanted)


def test_the_side_without_cohesion_is_the_registry_s_law_at_its_factors() -> None:
    phi, angle = math.radians(35.0), torch.full_like(STILL, 0.3)
    x = math.radians(45.0) - 0.5 * phi
    d_1 = 1.0 / math.tan(x) + math.tan(x + phi)
    d_2 = 1.0 / math.tan(x) + math.tan(phi) / math.tan(x) ** 2
    size = torch.tensor(0.5 * UNIT_WEIGHT * d_1 * d_2, dtype=torch.float64)
    loose = one_wheel(0.2, 0.03, math.tan(phi), 0.0)._replace(slip_angle=angle)
    law = HegedusSide(ROVER)
    wanted = first(side_resistance(size, loose.sinkage, RADIUS, quadrature())) * math.sin(0.3)
    assert first(added(law, loose, 1.0, 0.0).lateral) == pytest.approx(wanted)
    bound = one_wheel(0.2, 0.03, math.tan(phi))._replace(slip_angle=angle)
    assert first(added(law, bound, 1.0, 0.0).lateral) > wanted
    assert law.added_force(one_wheel(0.2, 0.03), values(1.0, 0.0)) is None


@pytest.mark.parametrize(
    ("degrees", "n_c", "n_gamma"), [(20.0, 17.7, 4.4), (30.0, 37.2, 20.1), (40.0, 95.7, 121.5)]
)
def test_bekker_s_factors_follow_from_the_factors_of_bearing_capacity(
    degrees: float, n_c: float, n_gamma: float
) -> None:
    """Of Coduto's table, whose N_c is Terzaghi's, to its digits."""
    tan_phi = math.tan(math.radians(degrees))
    by_cohesion, by_weight = wedge_factors(torch.tensor(tan_phi, dtype=torch.float64))
    square = math.cos(math.radians(degrees)) ** 2
    assert float(by_cohesion) == pytest.approx((n_c - tan_phi) * square, rel=5e-3)
    assert float(by_weight) == pytest.approx((2.0 * n_gamma / tan_phi + 1.0) * square, rel=1e-2)


def test_bekker_s_wedge_grows_with_depth_and_stays_behind_a_wheel_that_spins() -> None:
    """At 30 degrees and 1 cm, by hand from the formula in the docstring."""
    z, phi, tan_phi = 0.01, math.radians(30.0), math.tan(math.radians(30.0))
    ahead = math.acos(1.0 - z / RADIUS)
    by_cohesion, by_weight = map(float, wedge_factors(torch.tensor(tan_phi, dtype=torch.float64)))
    share = math.sin(ahead + phi) / (2.0 * math.sin(ahead) * math.cos(phi))
    wanted = WIDTH * share * (2.0 * z * COHESION * by_cohesion + UNIT_WEIGHT * z**2 * by_weight)
    reach = z / 3.0
    wanted += UNIT_WEIGHT * reach**3 / 3.0 * math.radians(60.0)
    wanted += COHESION * reach**2 * (1.0 + math.sqrt(3.0))
    law = BekkerWedge(ROVER)
    assert first(added(law, one_wheel(0.2, z, tan_phi), 1.0, 0.0).traction) == pytest.approx(
        -wanted
    )
    assert first(added(law, one_wheel(0.2, 2.0 * z, tan_phi), 1.0, 0.0).traction) < -1.5 * wanted
    assert first(added(law, one_wheel(1.0, z, tan_phi), 1.0, 0.0).traction) == 0.0
