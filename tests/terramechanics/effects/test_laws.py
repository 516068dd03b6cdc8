# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The formulas of the named effects against closed forms, limits and inverses."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate
from torch import Tensor

from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP, quadrature
from terramechanics.effects import describe, make_effect
from terramechanics.effects.grousers import (
    COHESIVE,
    GROUSER_SLIP,
    BlendedGrousers,
    Grousers,
    LoadedGrousers,
)
from terramechanics.effects.law import Readings
from terramechanics.effects.sensing import SHALLOWEST, OdometryScale, SinkageBias
from terramechanics.effects.soil import (
    REFERENCE_SPEED,
    SOFTEST,
    USUAL_COHESION,
    USUAL_FRICTION,
    WEDGE_DEPTH,
    BlendedBulldozing,
    Bulldozing,
    DugSinkage,
    ExitAngle,
    Multipass,
    RateDependence,
    SlipSinkage,
    side_resistance,
)
from terramechanics.effects.vehicle import CoulombDrag, DriveDrag
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import (
    ContactInputs,
    Effect,
    Plant,
    Pull,
    Situation,
    with_exponent,
    with_stiffness,
)
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.soil import CONSTANTS
from terramechanics.vehicle.suspension import BodyLoad
from tests.terramechanics.effects.wedge import resistance

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
AXLES = ROVER.axles


def number(*values: float) -> Tensor:
    return torch.tensor(values if len(values) != 1 else values[0], dtype=torch.float64)


def situation(rate: float = 1.2, velocity: float = 0.1, batch: int = 2) -> Situation:
    wheels = torch.ones(batch, AXLES, dtype=torch.float64)
    return Situation(
        ROVER, 0.0, torch.arange(batch), 0.0 * wheels, rate * wheels, velocity * wheels[:, 0]
    )


def contact(slip: float = 0.2, sinkage: float = 0.015, batch: int = 2) -> ContactInputs:
    wheels = torch.ones(batch, AXLES, dtype=torch.float64)
    return ContactInputs(slip * wheels, sinkage * wheels, SOIL.constants(), SOIL.strength())


def values(*row: float) -> Tensor:
    """Return the values [1, V] of a law."""
    return torch.tensor([row], dtype=torch.float64)


def column(*sizes: float) -> Tensor:
    """Return values [batch, 1] of a law, one for each episode."""
    return torch.tensor(sizes, dtype=torch.float64).unsqueeze(1)


def at_slips(*slips: float) -> ContactInputs:
    """Return the inputs of wheels in one row that slip differently."""
    return contact(batch=1)._replace(
        slip=values(*slips), sinkage=torch.full_like(values(*slips), 0.015)
    )


def stiffness(found: ContactInputs) -> Tensor:
    """Return the factor of k_c and k_phi, by which no other constant is multiplied."""
    factors = found.constants / SOIL.constants()
    by_name = dict(zip(CONSTANTS, factors.unbind(-1), strict=True))
    for name in {*CONSTANTS} - {"k_c", "k_phi"}:
        assert bool((by_name[name] == 1.0).all())
    torch.testing.assert_close(by_name["k_c"], by_name["k_phi"])
    return by_name["k_phi"]


def readings(slip: Tensor, sinkage: float = 0.015, slip_sd: float = 0.01) -> Readings:
    """Return readings of [n, A] wheels."""
    return Readings(
        slip=slip,
        slip_sd=torch.full_like(slip, slip_sd),
        sinkage=torch.full_like(slip, sinkage),
        torque=torch.ones_like(slip),
        pitch=torch.zeros_like(slip[:, :1]),
        acceleration=torch.zeros_like(slip[:, :1]),
        wheel_rate=torch.ones_like(slip),
    )


RATE = torch.full((1, AXLES), 1.2, dtype=torch.float64)


# laws


def test_resistances_and_torques_are_their_formulas() -> None:
    pushed = Bulldozing(ROVER).added_force(contact(sinkage=0.02), values(3e4))
    assert pushed is not None
    torch.testing.assert_close(pushed.traction, torch.full((2, AXLES), -12.0).double())
    assert not pushed.torque.any()
    assert pushed.lateral is None
    assert DriveDrag(ROVER).drive_loss(values(-1.5), values(2.0)).tolist() == [[-3.0]]
    dry = CoulombDrag(ROVER).drive_loss(values(-1.5, 0.0, 7.0), values(2.0))
    assert dry.tolist() == [[-2.0, 0.0, 2.0]]


@pytest.mark.parametrize("sinkage", [0.004, 0.03])
def test_the_side_resistance_is_its_integral(sinkage: float) -> None:
    radius, size = 0.13, 2e5
    entry = math.acos(1.0 - sinkage / radius)

    def pushed(theta: float) -> float:
        depth = radius * (math.cos(theta) - math.cos(entry))
        return size * depth**2 * (radius - depth * math.cos(theta))

    expected = integrate.quad(pushed, 0.0, entry)[0]
    found = float(side_resistance(number(size), number(sinkage), radius, quadrature(16)))
    assert found == pytest.approx(expected, rel=1e-8)


def test_grousers_push_with_63_percent_at_their_slip_and_with_all_far_beyond() -> None:
    law, part = Grousers(ROVER), 50.0 * (1.0 - math.exp(-1.0))
    for extra in (0.0, 0.7):  # the logarithm of that slip over its usual one
        mobilised = GROUSER_SLIP * math.exp(extra)
        lugs = law.added_force(at_slips(-mobilised, 0.0, mobilised, 100.0), values(50.0, extra))
        assert lugs is not None
        assert lugs.traction[0].tolist() == pytest.approx([-part, 0.0, part, 50.0])
        torch.testing.assert_close(lugs.torque, ROVER.wheel_radius * lugs.traction)


def test_lugs_under_load_push_by_load_and_cohesion_and_change_no_other_force() -> None:
    """On level ground without cohesion they push as :class:`Grousers` do, each at its load."""
    inputs, size = at_slips(-0.1, 0.05, 0.4), values(20.0, 0.3)
    plain = Grousers(ROVER).added_force(inputs, size)
    assert plain is not None
    forces = torch.zeros(1, 3, 4, 3, dtype=torch.float64)
    level = ROVER.weight / len(ROVER.wheels)
    forces[..., 0, :] = level * torch.tensor([0.5, 0.25, 0.25])
    found = LoadedGrousers(ROVER).under_load(forces, inputs, size) - forces
    assert not found[..., [0, 3], :].any()
    torch.testing.assert_close(found[..., 2, :], ROVER.wheel_radius * found[..., 1, :])
    length = ROVER.wheel_radius * math.acos(1.0 - 0.015 / ROVER.wheel_radius)
    cohesive = number(COHESIVE * ROVER.wheel_width * length / level, 0.0, 0.0)
    for loaded in (1.0, 0.3):
        added = LoadedGrousers(ROVER).under_load(loaded * forces, inputs, size) - loaded * forces
        shares = loaded * number(0.5, 0.25, 0.25) + cohesive  # of c, of tan(phi), and of neither
        torch.testing.assert_close(added[..., 1, :], plain.traction.unsqueeze(-1) * shares)


@given(size=st.floats(0.0, 200.0), shape=st.floats(-100.0, 100.0))
def test_blended_grousers_are_linear_in_both_values_and_push_with_the_size_far_beyond(
    size: float, shape: float
) -> None:
    slips = at_slips(-0.3, 0.0, 0.02, 0.1, 100.0)
    blend = BlendedGrousers(ROVER)
    both = blend.added_force(slips, values(size, shape))
    alone = [blend.added_force(slips, each) for each in (values(size, 0.0), values(0.0, shape))]
    usual = Grousers(ROVER).added_force(slips, values(size, 0.0))
    assert both is not None
    assert usual is not None
    parts = [each.traction for each in alone if each is not None]
    torch.testing.assert_close(parts[0], usual.traction)
    torch.testing.assert_close(both.traction, parts[0] + parts[1])
    torch.testing.assert_close(both.torque, ROVER.wheel_radius * both.traction)
    assert float(both.traction[0, -1]) == pytest.approx(size)
    assert float(parts[1][0, 2]) == pytest.approx(shape * (math.exp(-0.1) - math.exp(-0.4)))


@given(size=st.floats(0.0, 2.0), slip=st.floats(-0.6, 0.95), n=st.floats(0.5, 1.5))
def test_a_spinning_wheel_digs_by_the_amount_of_its_slip(
    size: float, slip: float, n: float
) -> None:
    constants = SOIL.constants().clone()
    constants[0] = n
    inputs = contact(slip)._replace(constants=constants)
    raised = torch.full((2, AXLES), n + size * abs(slip)).double()
    soft = SlipSinkage(ROVER).contact(inputs, values(size), RATE)
    torch.testing.assert_close(soft.constants[..., 1:], constants[1:].expand(2, AXLES, 5))
    torch.testing.assert_close(soft.constants[..., 0], raised)
    # Where none of the digging leaves no contact, that is all; where all of it does, the soil is
    # as it was, at the depth of the same pressure.
    touching, away = (
        DugSinkage(ROVER).contact(inputs, values(size, share), RATE) for share in (0.0, 1.0)
    )
    torch.testing.assert_close(touching.constants, soft.constants)
    torch.testing.assert_close(touching.sinkage, inputs.sinkage.expand(2, AXLES))
    torch.testing.assert_close(away.constants, constants.expand(2, AXLES, 6))
    torch.testing.assert_close(away.sinkage, inputs.sinkage ** (raised / n))


def test_a_rut_is_stiffened_by_every_wheel_that_went_before() -> None:
    """The extra value is the growth with later passes, less 1."""
    law = Multipass(ROVER)
    for size, extra, expected in (
        (0.4, 0.0, [1.0, 1.4, 1.8]),
        (0.4, -0.5, [1.0, 1.4, 1.6]),
        (-0.8, 0.0, [1.0, 0.2, SOFTEST]),
    ):
        found = stiffness(law.contact(contact(batch=1), values(size, extra), RATE))
        assert found[0].tolist() == pytest.approx(expected)


def test_the_rate_changes_nothing_at_the_reference_speed() -> None:
    law, reference = RateDependence(ROVER), REFERENCE_SPEED / ROVER.wheel_radius
    for size, times, expected in ((0.3, 1.0, 1.0), (0.5, 4.0, 2.0), (-0.5, 4.0, 0.5)):
        rate = torch.full((1, AXLES), times * reference, dtype=torch.float64)
        found = stiffness(law.contact(contact(batch=1), values(size), rate))
        assert found[0].tolist() == pytest.approx([expected] * AXLES, rel=1e-12)


def test_soil_that_springs_back_touches_the_wheel_up_to_its_height() -> None:
    inputs = contact(batch=1)._replace(sinkage=values(0.02, 0.0, -0.01))
    found = ExitAngle(ROVER).contact(inputs, values(ExitAngle.value_of(0.5)), RATE).exit_angle
    assert found is not None
    expected = math.acos(1.0 - 0.01 / ROVER.wheel_radius)
    assert found[0].tolist() == pytest.approx([expected, 0.0, 0.0])


@given(slip=st.floats(-0.5, 0.9), error=st.floats(-0.05, 0.05))
def test_a_slip_is_found_again_behind_the_error_of_the_radius(slip: float, error: float) -> None:
    """1 - v / (r w) with r larger by the share ``error``, and back."""
    law, true = OdometryScale(ROVER), readings(torch.full((1, AXLES), slip, dtype=torch.float64))
    reported = law.reported(true, values(error, 0.0))
    expected = torch.full((1, AXLES), 1.0 - (1.0 - slip) / (1.0 + error)).double()
    torch.testing.assert_close(reported.slip, expected, rtol=1e-6, atol=1e-12)
    back = law.corrected(reported, values(error, 0.0))
    torch.testing.assert_close(back.slip, true.slip, rtol=0.0, atol=1e-12)
    torch.testing.assert_close(back.slip_sd, true.slip_sd, rtol=1e-12, atol=0.0)


def test_what_is_corrected_stays_within_its_range() -> None:
    law = OdometryScale(ROVER)
    same = law.corrected(readings(values(-2.0, 0.3, 2.0)), values(0.0, 0.0))
    assert same.slip.tolist() == [[MIN_SLIP, 0.3, MAX_SLIP]]
    behind = law.corrected(readings(values(0.94, -0.59, -0.59)), values(0.3, 0.0)).slip[0].tolist()
    assert behind[0] == pytest.approx(0.922)
    assert behind[1:] == [MIN_SLIP, MIN_SLIP]
    deep = readings(torch.zeros(3, AXLES, dtype=torch.float64), 0.02)
    taken = SinkageBias(ROVER).corrected(deep, column(0.005, 0.019, -0.01)).sinkage
    for axle in range(AXLES):
        assert taken[:, axle].tolist() == pytest.approx([0.015, SHALLOWEST * 0.02, 0.03])


def test_uneven_radii_have_their_error_in_the_middle() -> None:
    law = OdometryScale(ROVER)
    assert law.error(values(0.1, 0.5))[0].tolist() == pytest.approx([0.05, 0.1, 0.15])
    assert law.error(values(0.1, 0.0))[0].tolist() == pytest.approx([0.1] * AXLES)
    law.order = torch.arange(2.0, dtype=torch.float64)  # the middle of two axles is between them
    assert law.error(values(0.1, 0.5))[0].tolist() == pytest.approx([0.075, 0.125])
    assert law.error(values(0.1, 0.0))[0].tolist() == pytest.approx([0.1, 0.1])


# where they act


def test_forces_are_changed_in_the_direction_in_which_the_effect_pushes() -> None:
    where, forces = situation(), torch.arange(24.0, dtype=torch.float64).view(2, 3, 4)
    pushed = make_effect("bulldozing", 3e4).push(where, contact(sinkage=0.02), forces) - forces
    expected = number(0.0, -resistance(3e4, 0.02, SOIL), 0.0, 0.0)
    torch.testing.assert_close(pushed, expected.expand(2, 3, 4))
    lugs = make_effect("grousers", 50.0).push(where, contact(), forces) - forces
    area = ROVER.wheel_width * ROVER.wheel_radius * math.acos(1.0 - 0.015 / ROVER.wheel_radius)
    held = forces[..., 0] + COHESIVE * SOIL.cohesion * area
    thrust = 50.0 * (1.0 - math.exp(-2.0)) * held * len(ROVER.wheels) / ROVER.weight
    none = torch.zeros_like(thrust)
    wanted = torch.stack([none, thrust, ROVER.wheel_radius * thrust, none], -1)
    torch.testing.assert_close(lugs, wanted)
    sizes = number(1e4, 2e4)
    each = make_effect("bulldozing", sizes).push(where, contact(sinkage=0.01), forces) - forces
    wanted = number(-resistance(1e4, 0.01, SOIL), -resistance(2e4, 0.01, SOIL))
    torch.testing.assert_close(each[:, :, 1], wanted[:, None].expand(2, 3))


@pytest.mark.parametrize(("more", "sinkage"), [(0.0, 0.01), (-0.35, 0.03), (0.25, 0.01)])
def test_a_wedge_resists_by_cohesion_with_the_depth_and_by_friction_with_its_square(
    more: float, sinkage: float
) -> None:
    forces = torch.zeros(2, AXLES, 4, dtype=torch.float64)
    soil = SOIL.with_values(cohesion=3000.0, tan_phi=0.4)
    inputs = contact(sinkage=sinkage)._replace(strength=soil.strength())
    pushed = describe("bulldozing").acting(values(1e4, more)).push(situation(), inputs, forces)
    wanted = number(0.0, -resistance(1e4, sinkage, soil, 0.75 + more), 0.0, 0.0)
    torch.testing.assert_close(pushed, wanted.expand(2, AXLES, 4))


def test_the_size_of_a_wedge_is_its_resistance_2_cm_deep_in_usual_soil() -> None:
    inputs = contact(sinkage=WEDGE_DEPTH)._replace(strength=number(USUAL_COHESION, USUAL_FRICTION))
    forces = torch.zeros(2, AXLES, 3, dtype=torch.float64)
    for more in (-1.0, 0.0, 0.25):
        wedge = describe("bulldozing").acting(values(1e4, more))
        pushed = wedge.push(situation(), inputs, forces)[..., 1]
        torch.testing.assert_close(pushed, torch.full_like(pushed, -1e4 * WEDGE_DEPTH**2))


@pytest.mark.parametrize(("slip", "share"), [(-0.3, 1.0), (0.94, 1.0), (0.975, 0.5), (1.0, 0.0)])
def test_a_wheel_that_only_spins_pushes_no_wedge(slip: float, share: float) -> None:
    forces = torch.zeros(2, AXLES, 3, dtype=torch.float64)
    pushed = make_effect("bulldozing", 1e4).push(situation(), contact(slip), forces)[..., 1]
    wanted = torch.full_like(pushed, -share * resistance(1e4, 0.015, SOIL))
    torch.testing.assert_close(pushed, wanted)


def test_a_blended_wedge_is_that_of_usual_soil_and_linear_in_both_values() -> None:
    law = BlendedBulldozing(ROVER)

    def traction(sinkage: float, size: float, cohesive: float) -> float:
        added = law.added_force(contact(sinkage=sinkage), values(size, cohesive))
        assert added is not None
        return float(added.traction[0, 0])

    usual = SOIL.with_values(cohesion=USUAL_COHESION, tan_phi=USUAL_FRICTION)
    for sinkage in (0.005, 0.02, 0.04):
        wanted = -resistance(1e4, sinkage, usual, 0.75 - 0.3)
        assert traction(sinkage, 1e4, -3e3) == pytest.approx(wanted)
        parts = traction(sinkage, 1e4, 0.0) + traction(sinkage, 0.0, -3e3)
        assert parts == pytest.approx(wanted)


@pytest.mark.parametrize("tan_phi", [0.3, 0.45, 0.58, 0.8, 1.0])
def test_passive_pressure_goes_with_tan_phi_within_15_percent(tan_phi: float) -> None:
    root = tan_phi + math.sqrt(1.0 + tan_phi**2)
    assert 3.0 * tan_phi / USUAL_FRICTION == pytest.approx(root**2, rel=0.15)


def test_the_side_of_a_wheel_pushes_against_its_slip_angle_and_not_straight_ahead() -> None:
    where, forces = situation(), torch.zeros(2, 3, 4, dtype=torch.float64)
    straight = contact()
    described = describe("lateral_bulldozing")
    sides = described.acting(described.values(2e5))
    assert sides.push(where, straight, forces) is forces
    for angle in (0.3, -0.3):
        turned = ContactInputs(
            straight.slip, straight.sinkage, straight.constants, straight.strength,
            slip_angle=torch.full_like(straight.slip, angle),
        )  # fmt: skip
        pushed = sides.push(where, turned, forces)
        side = side_resistance(number(2e5), straight.sinkage, ROVER.wheel_radius, quadrature())
        assert pushed.shape == forces.shape
        assert not pushed[..., :3].any()
        torch.testing.assert_close(pushed[..., 3], side * math.sin(angle))


def test_soil_constants_are_multiplied_by_name() -> None:
    factor = number(2.0, 3.0)[:, None].expand(2, AXLES)
    changed = with_exponent(contact(), factor).constants
    stiffer = with_stiffness(contact(), factor).constants
    plain = SOIL.constants()
    for column, name in enumerate(CONSTANTS):
        for row, times in enumerate((2.0, 3.0)):
            n_times = times if name == "n" else 1.0
            k_times = times if name in {"k_c", "k_phi"} else 1.0
            assert changed[row, 0, column] == pytest.approx(float(plain[column]) * n_times)
            assert stiffer[row, 1, column] == pytest.approx(float(plain[column]) * k_times)


def test_each_wheel_has_the_speed_and_order_of_its_situation_and_the_size_of_its_episode() -> None:
    where = situation(rate=2.0, batch=3)
    part = where.rows(torch.tensor([2, 0]))
    for size, expected in (
        (0.5, [0.5, 0.5]),
        (number(7.0), [7.0, 7.0]),
        (number(1.0, 2.0, 3.0), [3.0, 1.0]),
    ):
        lost = make_effect("coulomb_drag", size).friction(part)
        assert lost.tolist() == [[each] * AXLES for each in expected]
    assert part.rate.shape == (2, AXLES)
    torch.testing.assert_close(
        where.speed, 2.0 * ROVER.wheel_radius * torch.ones(3, AXLES).double()
    )
    assert where.order.tolist() == [0.0, 1.0, 2.0]


def test_a_plant_adds_frictions_masses_and_pulls() -> None:
    class Wind(Effect):
        def pull(self, where: Situation) -> Pull:
            return Pull(
                torch.full_like(where.velocity, -30.0), torch.zeros_like(where.velocity), 0.1, 0.5
            )

    where = situation(rate=1.5)
    drags = [make_effect("drive_drag", 2.0), make_effect("coulomb_drag", 0.5)]
    plant = Plant([*drags, make_effect("payload", number(10.0, 20.0)), Wind()])
    torch.testing.assert_close(plant.friction(where), torch.full((2, AXLES), 3.5).double())
    body = plant.body(where)
    assert isinstance(body.mass, Tensor)
    assert body.mass.tolist() == pytest.approx([ROVER.mass + 10.0, ROVER.mass + 20.0])
    centre = (body.x, body.height)
    for value, expected in zip(
        centre, (ROVER.centre_of_mass_x, ROVER.centre_of_mass_height), strict=True
    ):
        torch.testing.assert_close(
            torch.as_tensor(value), torch.full((2,), expected, dtype=torch.float64)
        )
    assert body.outer is not None
    moment = 30.0 * (0.5 - ROVER.centre_of_mass_height)
    torch.testing.assert_close(
        body.outer, number(-30.0, 0.0, moment).expand(2, 3), rtol=1e-12, atol=1e-12
    )
    assert not Plant([]).friction(where).any()
    assert Plant([]).body(where).outer is None


def test_a_load_moves_the_centre_of_mass_by_its_lever() -> None:
    body = BodyLoad(3.7, 100.0, 0.1, 0.4)
    loaded = body.loaded(number(25.0), number(0.6), number(0.9))
    assert float(torch.as_tensor(loaded.mass)) == 125.0
    assert float(torch.as_tensor(loaded.x)) == pytest.approx((100.0 * 0.1 + 25.0 * 0.6) / 125.0)
    assert float(torch.as_tensor(loaded.height)) == pytest.approx(0.5)
    assert float(torch.as_tensor(loaded.weight)) == pytest.approx(3.7 * 125.0)
    both = body.pulled(number(1.0), number(2.0), 0.3, 0.5).pulled(
        number(1.0), number(2.0), 0.3, 0.5
    )
    assert both.outer is not None
    assert both.outer.tolist() == pytest.approx([2.0, 4.0, 2.0 * (0.2 * 2.0 - 0.1 * 1.0)])


@pytest.mark.parametrize("size", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("axle", [0, 2])
def test_a_failed_wheel_slips_as_the_torque_that_is_left_calls_for(size: float, axle: int) -> None:
    given_contact, where = contact(slip=0.3), situation()
    effect = make_effect("failed_wheel", size, axle)
    effect.begin(ROVER, 2)
    first = effect.contact(where, given_contact)
    failed = effect.contact(where, given_contact)
    assert torch.equal(failed.slip, first.slip)  # it does not depend on earlier searches
    nodes = quadrature(12)
    before, after = (
        c.forces(ROVER.wheel_radius, ROVER.wheel_width, nodes)[..., 2]
        for c in (given_contact, failed)
    )
    expected = before.clone()
    expected[:, axle] *= 1.0 - size
    torch.testing.assert_close(after, expected, rtol=1e-4, atol=1e-4)
    others = [k for k in range(AXLES) if k != axle]
    assert torch.equal(failed.slip[:, others], given_contact.slip[:, others])
    assert torch.equal(failed.sinkage, given_contact.sinkage)


def test_wheels_that_fail_in_part_are_each_found() -> None:
    """One has nothing to search for, the others must not stop with it."""
    slip = contact().slip * number(0.5, 1.0, 2.0, 3.0)[:, None].expand(4, AXLES)[:2]
    whole = ContactInputs(slip, contact().sinkage, SOIL.constants(), SOIL.strength())
    failed = make_effect("failed_wheel", number(0.0, 0.9), 1).contact(situation(), whole)
    nodes = quadrature(12)
    before, after = (
        c.forces(ROVER.wheel_radius, ROVER.wheel_width, nodes)[:, 1, 2] for c in (whole, failed)
    )
    assert after.tolist() == pytest.approx((before * number(1.0, 0.1)).tolist(), rel=1e-4)


def test_a_tilted_attitude_sensor_changes_the_pitch_and_not_the_specific_force() -> None:
    generator = torch.Generator().manual_seed(1)
    drive = simulate(ROVER, Ground.constant(SOIL), "S1", 2.0, generator, 1)
    effect = make_effect("slope_bias", 0.03)
    effect.begin(ROVER, 1)
    told = effect.sensed(drive.sample)
    torch.testing.assert_close(told.pitch, drive.sample.pitch + 0.03)
    torch.testing.assert_close(
        told.specific_force(ROVER.gravity), drive.sample.specific_force(ROVER.gravity)
    )


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.25, 0.7])
def test_what_a_camera_sees_is_reported_late(delay: float) -> None:
    """Interpolated between two samples; before the first it is the first's."""
    generator = torch.Generator().manual_seed(2)
    plant = Plant([make_effect("latency", delay)])
    drive = simulate(ROVER, Ground.constant(SOIL), "S1", 2.0, generator, 1, plant=plant)
    true, told = drive.sample.sinkage[0], drive.seen.sinkage[0]
    assert told.shape == true.shape
    for step in range(true.shape[0]):
        at = max(step - delay / 0.1, 0.0)
        below = math.floor(at + 1e-9)
        share = at - below
        expected = true[below] if share < 1e-9 else torch.lerp(true[below], true[below + 1], share)
        torch.testing.assert_close(told[step], expected, rtol=1e-9, atol=1e-12)
    assert torch.equal(drive.seen.velocity, drive.sample.velocity)


def test_noise_keeps_its_correlation_its_scatter_and_its_claims() -> None:
    """40 drives of 60 s, 24000 values each: the scatter over the claim is 1 within 4 standard
    errors (0.5 % each), the correlation of neighbours within 4 / sqrt(24000)."""
    generator = torch.Generator().manual_seed(3)
    drive = simulate(ROVER, Ground.constant(SOIL), "S3", 3.0, generator, 1)
    wide = drive.sample
    long = type(wide)(
        *(
            getattr(wide, name).repeat(40, 20, *[1] * (getattr(wide, name).dim() - 2))
            for name in type(wide).__slots__
        )
    )
    for correlation in (0.0, 0.6):
        measured = measure_drive(ROVER, long, Noise(), generator, correlation)
        for name in ("slip", "sinkage", "velocity", "contact_angle", "torque", "pitch"):
            error = getattr(measured, name) - getattr(long, name)
            share = error / getattr(measured, f"{name}_sd")
            assert float(share.std()) == pytest.approx(1.0, abs=0.03), name
            white = error - error.mean()
            neighbours = (white[:, 1:] * white[:, :-1]).mean() / (white**2).mean()
            assert float(neighbours) == pytest.approx(correlation, abs=0.03), name
        constants = {"velocity": 0.01, "pitch": math.radians(0.3)}
        constants["contact_angle"] = math.radians(0.3)
        for name, constant in constants.items():
            claimed = getattr(measured, f"{name}_sd")
            torch.testing.assert_close(claimed, torch.full_like(claimed, constant))
        unit = 0.3 * ROVER.wheel_radius * ROVER.weight / len(ROVER.wheels)
        parts = {"slip": (0.05, 0.005), "sinkage": (0.05, ROVER.sinkage_noise_floor)}
        for name, (relative, constant) in (parts | {"torque": (0.03, 0.01 * unit)}).items():
            value, claimed = getattr(measured, name), getattr(measured, f"{name}_sd")
            torch.testing.assert_close(claimed, torch.hypot(relative * value, number(constant)))
        bias = (measured.acceleration - long.specific_force(ROVER.gravity)).mean(1)
        assert float(bias.std()) == pytest.approx(0.02, rel=0.5)
        assert float(measured.acceleration_sd.max()) == pytest.approx(0.02 * math.sqrt(2.0))
