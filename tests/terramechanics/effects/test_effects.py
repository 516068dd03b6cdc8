# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every named effect in the simulation: direction, amount, and nothing without size."""

from dataclasses import fields
from functools import cache

import pytest
import torch
from torch import Tensor

from terramechanics.contact.sinkage import WheelGround
from terramechanics.contact.stresses import entry_angle, quadrature, wheel_forces
from terramechanics.effects import EFFECTS, make_effect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs, Effect, Plant, Pull, Situation
from terramechanics.simulation.sample import TIME_STEP, Drive, Sample
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Flat
from tests.samples import sampled
from tests.terramechanics.effects.wedge import resistance

MARS = load_rover("mars_rover")
LOOSE = load_soil("loose_sand")
BATCH = 4
PART_S = sampled(1.0, 4.0)
PART = round(PART_S / TIME_STEP)
"""Seconds and samples of what is compared to the very number."""
SIMULATED = [name for name, effect in EFFECTS.items() if effect.planar]
SIZES = {
    "slope_bias": 0.02,
    "bulldozing": 1e4,
    "drive_drag": 0.5,
    "coulomb_drag": 0.5,
    "payload": 20.0,
    "grousers": 5.0,
    "slip_sinkage": 0.3,
    "multipass": 0.3,
    "odometry_scale": 0.05,
    "failed_wheel": 0.6,
    "sinkage_bias": 0.002,
    "latency": 0.25,
    "rate_dependence": 0.2,
    "exit_angle": 0.2,
    "contact_law_scm": 0.2,
}


def drive(plant: Plant | None = None, schedule: str = "S1", seconds: float = 4.0) -> Drive:
    generator = torch.Generator().manual_seed(11)
    ground = Ground.random_strength(
        LOOSE, BATCH, generator, cohesion=(1000.0, 3000.0), friction_angle=(0.5, 0.7)
    )
    return simulate(MARS, ground, schedule, seconds, generator, BATCH, plant=plant)


@cache
def nominal(schedule: str = "S1") -> Drive:
    return drive(schedule=schedule)


@cache
def with_effect(name: str, share: float = 1.0) -> Drive:
    return drive(Plant([make_effect(name, share * SIZES[name])]))


def moved(name: str, signal: str, share: float = 1.0) -> Tensor:
    """Return the change of the sensors' samples, [batch, time] or [batch, time, axles]."""
    return getattr(with_effect(name, share).seen, signal) - getattr(nominal().seen, signal)


def rms(values: Tensor) -> float:
    return float(values.square().mean().sqrt())


def situation(episodes: int = 1) -> Situation:
    wheels = torch.full((episodes, 3), 1.5, dtype=torch.float64)
    return Situation(
        MARS,
        1.0,
        torch.arange(episodes),
        torch.zeros_like(wheels),
        wheels,
        torch.full((episodes,), 0.15, dtype=torch.float64),
    )


def contact(slip: float = 0.2, sinkage: float = 0.02) -> ContactInputs:
    wheels = torch.ones(1, 3, dtype=torch.float64)
    return ContactInputs(
        slip * wheels,
        sinkage * wheels,
        LOOSE.constants().expand(1, 3, 6),
        LOOSE.strength().expand(1, 3, 2),
    )


@pytest.mark.parametrize("name", SIMULATED)
def test_an_effect_without_size_leaves_the_simulation_as_it_is(name: str) -> None:
    sizes = torch.zeros(BATCH, dtype=torch.float64)
    run = drive(Plant([make_effect(name, sizes)]), seconds=PART_S)
    for series, plain in ((run.sample, nominal().sample), (run.seen, nominal().seen)):
        for item in fields(Sample):
            torch.testing.assert_close(
                getattr(series, item.name),
                getattr(plain, item.name)[:, :PART],
                rtol=1e-11,
                atol=1e-11,
                equal_nan=True,
            )


def test_a_simulation_with_an_empty_plant_is_the_same_to_the_last_bit() -> None:
    run = drive(Plant([]))
    for item in fields(Sample):
        torch.testing.assert_close(
            getattr(run.seen, item.name),
            getattr(nominal().sample, item.name),
            rtol=0.0,
            atol=0.0,
            equal_nan=True,
        )


@pytest.mark.parametrize("name", SIMULATED)
def test_a_tenth_of_the_size_has_about_a_tenth_of_the_effect(name: str) -> None:
    signals = ("velocity", "slip", "sinkage", "torque", "pitch")
    whole, tenth = ([rms(moved(name, signal, share)) for signal in signals] for share in (1.0, 0.1))
    largest = max(
        range(len(signals)), key=lambda k: whole[k] / rms(getattr(nominal().seen, signals[k]))
    )
    # The exit angle, and with it the effect, goes like the root of the rebound.
    assert (2.0 if name == "exit_angle" else 4.0) < whole[largest] / tenth[largest] < 25.0


@pytest.mark.parametrize("name", SIMULATED)
def test_episodes_of_one_batch_have_their_own_sizes(name: str) -> None:
    sizes = SIZES[name] * torch.tensor([0.0, 1.0, 0.0, 1.0], dtype=torch.float64)
    run, plain, full = (
        drive(Plant([make_effect(name, sizes)]), seconds=PART_S).seen,
        nominal().seen,
        with_effect(name).seen,
    )
    for signal in ("velocity", "slip", "sinkage", "torque", "pitch"):
        mixed, without, whole = (getattr(series, signal)[:, :PART] for series in (run, plain, full))
        torch.testing.assert_close(mixed[::2], without[::2], rtol=1e-6, atol=1e-8)
        torch.testing.assert_close(mixed[1::2], whole[1::2], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize(
    ("name", "signal", "sign"),
    [
        ("bulldozing", "slip", 1),
        ("bulldozing", "torque", 1),
        ("payload", "sinkage", 1),
        ("payload", "torque", 1),
        ("grousers", "slip", -1),
        ("grousers", "velocity", 1),
        ("slip_sinkage", "sinkage", 1),
        ("exit_angle", "sinkage", -1),
        ("rate_dependence", "sinkage", -1),
    ],
)
def test_an_effect_moves_a_signal_in_its_direction(name: str, signal: str, sign: int) -> None:
    assert sign * float(moved(name, signal).mean()) > 0.0


@pytest.mark.parametrize(
    "name",
    ["slope_bias", "odometry_scale", "sinkage_bias", "latency", "drive_drag", "coulomb_drag"],
)
def test_what_sensors_and_drives_do_does_not_move_the_rover(name: str) -> None:
    run, plain = with_effect(name).sample, nominal().sample
    for signal in ("velocity", "slip", "sinkage", "normal", "traction", "ground_torque", "pitch"):
        assert torch.equal(getattr(run, signal), getattr(plain, signal))


def test_sensor_effects_are_what_their_page_says() -> None:
    plain = nominal().seen
    torch.testing.assert_close(moved("slope_bias", "pitch"), torch.full_like(plain.pitch, 0.02))
    torch.testing.assert_close(
        with_effect("slope_bias").seen.specific_force(MARS.gravity),
        plain.specific_force(MARS.gravity),
    )
    torch.testing.assert_close(
        moved("sinkage_bias", "sinkage"), torch.full_like(plain.sinkage, 0.002)
    )
    torch.testing.assert_close(with_effect("odometry_scale").seen.slip, (plain.slip + 0.05) / 1.05)
    late = with_effect("latency").seen
    torch.testing.assert_close(late.slip[:, 3:], (plain.slip[:, 1:-2] + plain.slip[:, :-3]) / 2.0)
    assert torch.equal(late.torque, plain.torque)


def test_drag_adds_to_the_motor_torque_what_its_law_says() -> None:
    torch.testing.assert_close(moved("drive_drag", "torque"), 0.5 * nominal().seen.wheel_rate)
    torch.testing.assert_close(
        moved("coulomb_drag", "torque"), torch.full_like(nominal().seen.torque, 0.5)
    )


def test_under_torque_commands_drag_is_lost_to_the_ground() -> None:
    run = drive(Plant([make_effect("coulomb_drag", 0.3)]), "S2").sample
    loss = (
        run.torque
        - run.ground_torque
        - nominal("S2").sample.torque
        + nominal("S2").sample.ground_torque
    )
    inertia = (
        MARS.wheel_inertia * (run.wheel_rate - nominal("S2").sample.wheel_rate).diff(dim=1) / 0.1
    )
    torch.testing.assert_close(
        (loss[:, 1:] - inertia)[:, :5], torch.full_like(inertia, 0.3)[:, :5], rtol=1e-6, atol=1e-6
    )
    assert float(
        (run.ground_torque - nominal("S2").sample.ground_torque)[:, :5].mean()
    ) == pytest.approx(-0.3, abs=1e-3)


def test_payload_is_carried_and_accelerated_by_the_wheels() -> None:
    for extra in (0.0, 20.0):
        run = (with_effect("payload") if extra else nominal()).sample
        mass = MARS.mass + extra
        cosine, sine = torch.cos(run.contact_angle), torch.sin(run.contact_angle)
        up = 2.0 * (run.normal * cosine + run.traction * sine).sum(-1)
        along = 2.0 * (run.traction * cosine - run.normal * sine).sum(-1)
        torch.testing.assert_close(
            up, mass * MARS.gravity * torch.cos(run.pitch), rtol=1e-8, atol=1e-6
        )
        torch.testing.assert_close(
            along, mass * run.specific_force(MARS.gravity), rtol=1e-8, atol=1e-6
        )


def test_bulldozing_takes_traction_but_no_torque() -> None:
    wheel, where = contact(), situation()
    forces = wheel.forces(MARS.wheel_radius, MARS.wheel_width, quadrature())
    pushed = make_effect("bulldozing", 1e4).push(where, wheel, forces) - forces
    wanted = torch.tensor([0.0, -resistance(1e4, 0.02, LOOSE), 0.0], dtype=torch.float64)
    torch.testing.assert_close(pushed, wanted.expand(1, 3, 3))


def test_grousers_push_forward_when_driven_and_backward_when_braked() -> None:
    where = situation()
    for slip, thrust in ((0.1, 5.0 * (1.0 - torch.e**-1.0)), (-0.1, -5.0 * (1.0 - torch.e**-1.0))):
        wheel = contact(slip)
        on_soil = torch.zeros(1, 3, 3, dtype=torch.float64)
        on_soil[..., 0] = MARS.weight / len(MARS.wheels)
        without_cohesion = wheel._replace(strength=wheel.strength * torch.tensor([0.0, 1.0]))
        added = make_effect("grousers", 5.0).push(where, without_cohesion, on_soil) - on_soil
        torch.testing.assert_close(
            added[0, 0],
            torch.tensor([0.0, thrust, MARS.wheel_radius * thrust], dtype=torch.float64),
        )


def test_the_soil_laws_change_the_constants_that_they_name() -> None:
    where, plain = situation(), contact()
    n, k_c, k_phi = plain.constants[0, :, :3].unbind(-1)
    dug = make_effect("slip_sinkage", 0.5).contact(where, plain).constants[0]
    torch.testing.assert_close(dug[:, 0], n + 0.5 * 0.2)
    rolled = make_effect("multipass", 0.5).contact(where, plain).constants[0]
    torch.testing.assert_close(
        rolled[:, 1], k_c * torch.tensor([1.0, 1.5, 2.0], dtype=torch.float64)
    )
    faster = make_effect("rate_dependence", 0.5).contact(where, plain).constants[0]
    torch.testing.assert_close(faster[:, 2], k_phi * (0.13 * 1.5 / 0.1) ** 0.5)


def test_a_failed_wheel_gets_the_share_of_torque_that_is_left_and_others_keep_their_slip() -> None:
    where, plain = situation(), contact(0.3)
    nodes = quadrature(12)
    for share in (0.3, 1.0):
        altered = make_effect("failed_wheel", share, axle=0).contact(where, plain)
        before, after = (
            wheel.forces(MARS.wheel_radius, MARS.wheel_width, nodes)[0, :, 2]
            for wheel in (plain, altered)
        )
        torch.testing.assert_close(after[0], (1.0 - share) * before[0], rtol=1e-5, atol=1e-4)
        assert altered.slip[0, 1:].tolist() == [0.3, 0.3]
    free = make_effect("failed_wheel", 1.0, axle=0).contact(where, plain)
    assert float(free.slip[0, 0]) < 0.0


def test_contact_behind_the_axle_carries_load_and_holds_back() -> None:
    slip, sinkage = (
        torch.tensor([0.2, -0.3], dtype=torch.float64),
        torch.tensor([0.02, 0.02], dtype=torch.float64),
    )
    args = (slip, sinkage, LOOSE.constants(), MARS.wheel_radius, MARS.wheel_width)
    short = wheel_forces(*args, quadrature(24))
    assert torch.equal(short, wheel_forces(*args, quadrature(24), None))
    torch.testing.assert_close(
        wheel_forces(*args, quadrature(24), torch.zeros(2, dtype=torch.float64)), short
    )
    behind = entry_angle(0.4 * sinkage, MARS.wheel_radius)
    long = wheel_forces(*args, quadrature(24), behind)
    assert bool((long[:, 0, 2] > short[:, 0, 2]).all())
    torch.testing.assert_close(
        wheel_forces(*args, quadrature(48), behind), long, rtol=1e-6, atol=1e-4
    )


def test_the_stresses_behind_the_axle_are_integrated_like_a_plain_sum() -> None:
    """Compare the stretched rear branch with a Riemann sum (Ishigami et al. 2007), for N, T, M."""
    slip, sinkage, reach = 0.3, 0.02, 0.2
    n, k_c, k_phi, shear, c1, c2 = LOOSE.constants()
    cohesion, tan_phi = LOOSE.strength()
    r, b = MARS.wheel_radius, MARS.wheel_width
    entry = float(entry_angle(torch.tensor(sinkage, dtype=torch.float64), r))
    peak = float(c1 + c2 * slip) * entry
    count = 400_000
    theta = -reach + (entry + reach) * (torch.arange(count, dtype=torch.float64) + 0.5) / count
    mirrored = torch.where(
        theta > peak, theta, entry - (theta + reach) * (entry - peak) / (peak + reach)
    )
    sigma = (k_c / b + k_phi) * (r * (torch.cos(mirrored) - torch.tensor(entry).cos())).clamp(
        min=0.0
    ) ** n
    j = r * (
        (entry - theta)
        - (1.0 - slip) * (torch.tensor(entry, dtype=torch.float64).sin() - torch.sin(theta))
    )
    tau = (cohesion + sigma * tan_phi) * (1.0 - torch.exp(-j / shear))
    area = r * b * (entry + reach) / count
    expected = (
        torch.stack(
            [
                (tau * theta.sin() + sigma * theta.cos()).sum(),
                (tau * theta.cos() - sigma * theta.sin()).sum(),
                r * tau.sum(),
            ]
        )
        * area
    )
    one, depth, behind = (
        torch.tensor([value], dtype=torch.float64) for value in (slip, sinkage, reach)
    )
    wheel = ContactInputs(one, depth, LOOSE.constants(), LOOSE.strength(), behind)
    torch.testing.assert_close(
        wheel.forces(r, b, quadrature(24))[0], expected, rtol=1e-5, atol=1e-4
    )


class SteadyPull(Effect):
    """A constant pull backwards at a height."""

    def __init__(self, force: float, height: float) -> None:
        self.force, self.height = force, height

    def pull(self, where: Situation) -> Pull:
        zero = torch.zeros_like(where.velocity)
        return Pull(zero - self.force, zero, x=-1.0, height=self.height)


def test_a_pull_on_the_body_is_balanced_by_the_wheels_and_shifts_load_to_the_rear() -> None:
    generator = torch.Generator().manual_seed(2)
    ground = Ground.constant(LOOSE)
    plants = (None, Plant([SteadyPull(20.0, 0.45)]))
    runs = [
        simulate(MARS, ground, "S3", 1.0, generator.manual_seed(2), 1, Flat(), plant=plant)
        for plant in plants
    ]
    plain, held = (run.sample for run in runs)
    torch.testing.assert_close(
        2.0 * held.traction.sum(-1), MARS.mass * held.acceleration + 20.0, rtol=1e-8, atol=1e-6
    )
    assert float(held.slip.mean()) > float(plain.slip.mean())
    assert (
        float((held.normal - plain.normal)[0, -1, 0])
        < 0.0
        < float((held.normal - plain.normal)[0, -1, 2])
    )


def test_two_effects_act_together() -> None:
    both = drive(Plant([make_effect("coulomb_drag", 0.5), make_effect("sinkage_bias", 0.002)])).seen
    torch.testing.assert_close(both.torque, with_effect("coulomb_drag").seen.torque)
    torch.testing.assert_close(both.sinkage, with_effect("sinkage_bias").seen.sinkage)


def test_many_braked_wheels_are_treated_apart_with_an_exit_angle_too() -> None:
    slip = torch.linspace(-0.3, 0.5, 300, dtype=torch.float64).reshape(100, 3)
    sinkage = torch.full_like(slip, 0.02)
    where = situation(100)
    ground = (LOOSE.constants().expand(100, 3, 6), LOOSE.strength().expand(100, 3, 2))
    wheels = WheelGround.of(MARS, *ground, 12, Plant([make_effect("exit_angle", 0.3)]), where)
    few = wheels.rows(torch.arange(20))
    torch.testing.assert_close(
        wheels.forces(slip, sinkage)[:20], few.forces(slip[:20], sinkage[:20]), rtol=1e-5, atol=1e-4
    )
