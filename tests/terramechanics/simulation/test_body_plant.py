# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects on rovers that turn: straight ahead those of the planar simulator, and what turns do."""

import dataclasses

import pytest
import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from terramechanics.contact.tracks import LONGEST
from terramechanics.effects import EFFECTS, make_effect
from terramechanics.effects.simulated import SimulatedEffect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.plant import Effect, Plant, Pull, Situation
from terramechanics.simulation.sample import Sample
from terramechanics.simulation.schedules import Command
from terramechanics.simulation.simulation import Simulation
from terramechanics.simulation.spatial import BodySample, BodySimulation
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Flat
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.steering import skid_command
from terramechanics.vehicle.wheel_places import chassis_places

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
SIX = Chassis.of(ROVER, track=1.0, yaw_inertia=40.0)
FOUR_ROVER = load_rover("four_wheel_rover")
FOUR = Chassis.of(FOUR_ROVER, track=0.57, yaw_inertia=5.0)
SIZES = {
    "bulldozing": 2e4,
    "drive_drag": 2.0,
    "coulomb_drag": 1.0,
    "payload": 20.0,
    "grousers": 20.0,
    "slip_sinkage": 0.5,
    "multipass": 1.0,
    "rate_dependence": 0.3,
    "exit_angle": 0.3,
}


def effect_of(name: str, size: float) -> SimulatedEffect:
    return EFFECTS[name].acting(EFFECTS[name].values(size))


def body(chassis: Chassis, plant: BodyPlant | None, batch: int = 1) -> BodySimulation:
    return BodySimulation(
        chassis,
        SOIL.constants().expand(batch, 6),
        SOIL.strength().expand(batch, 2),
        effects=plant,
    )


def driven(plant: BodyPlant | None, twist: tuple[float, float, float], steps: int) -> BodySample:
    simulation = body(FOUR, plant)
    command = skid_command(FOUR, torch.tensor([twist], dtype=torch.float64))
    samples = [simulation.step(*command) for _ in range(steps)]
    assert all(bool(sample.solved.all()) for sample in samples)
    return samples[-1]


@pytest.mark.parametrize("name", SIZES)
def test_straight_ahead_an_effect_is_that_of_the_planar_simulator(name: str) -> None:
    planar = Simulation(
        ROVER,
        Ground.constant(SOIL),
        Flat(),
        torch.full((1,), 0.1, dtype=torch.float64),
        plant=Plant([make_effect(name, SIZES[name])]),
    )
    turning = body(SIX, BodyPlant(Plant([make_effect(name, SIZES[name])]), ROVER))
    rates = torch.tensor([[1.2, 1.3, 1.1]], dtype=torch.float64)
    rim, straight = rates.repeat(1, 2) * ROVER.wheel_radius, torch.zeros(1, 6, dtype=torch.float64)
    planar.settle(rates)
    turning.settle(rim, straight, torch.tensor([[0.1, 0.0, 0.0]], dtype=torch.float64))
    nominal = body(SIX, None)
    nominal.settle(rim, straight, torch.tensor([[0.1, 0.0, 0.0]], dtype=torch.float64))
    steps = [
        (planar.step(Command.RATE, rates), turning.step(rim, straight), nominal.step(rim, straight))
        for _ in range(3)
    ]
    expected, found, bare = steps[-1]
    assert bool(found.solved.all())
    assert abs(float(found.velocity[0, 0] - expected.velocity)) < 1e-9
    assert (found.sinkage - expected.sinkage.repeat(1, 2)).abs().max() < 1e-9
    assert (found.torque - expected.torque.repeat(1, 2)).abs().max() < 1e-7
    assert (found.forces[..., 0] - expected.normal.repeat(1, 2)).abs().max() < 1e-6
    changed = torch.cat([found.velocity - bare.velocity, found.torque - bare.torque], 1)
    assert float(changed.abs().max()) > 1e-3


@pytest.mark.parametrize("name", [name for name in SIZES if name not in ("payload", "multipass")])
def test_backing_out_it_acts_the_other_way(name: str) -> None:
    """The rover is the same front and rear but for its centre of mass."""
    middle = dataclasses.replace(FOUR_ROVER, centre_of_mass_x=0.0)
    plant = BodyPlant(Plant([effect_of(name, SIZES[name])]), middle)
    chassis = Chassis.of(middle, track=0.57, yaw_inertia=5.0)
    simulation = body(chassis, plant, batch=2)
    twists = torch.tensor([[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]], dtype=torch.float64)
    last = [simulation.step(*skid_command(chassis, twists)) for _ in range(12)][-1]
    assert bool(last.solved.all())
    assert float(last.velocity[1, 0]) == pytest.approx(-float(last.velocity[0, 0]), rel=1e-8)
    torch.testing.assert_close(last.torque[1, [1, 0, 3, 2]], -last.torque[0], rtol=1e-7, atol=0.0)


@pytest.mark.parametrize("name", ["four_wheel_rover", "mars_rover"])
def test_no_bulldozing_drives_a_rover_back(name: str) -> None:
    """At the largest size a rover that is commanded ahead stays where it is at worst."""
    rover = load_rover(name)
    chassis = Chassis.of(rover, track=0.57, yaw_inertia=5.0)
    simulation = body(chassis, BodyPlant(Plant([effect_of("bulldozing", 2e5)]), rover))
    command = skid_command(chassis, torch.tensor([[0.15, 0.0, 0.0]], dtype=torch.float64))
    last = [simulation.step(*command) for _ in range(15)][-1]
    assert bool(last.solved.all())
    assert float(last.velocity[0, 0]) > -1e-6
    assert float(last.slip.max()) > 0.9


def test_at_rest_nothing_pushes_a_rover_along() -> None:
    plant = BodyPlant(Plant([effect_of("bulldozing", 1e5)]), FOUR_ROVER)
    last = driven(plant, (0.0, 0.0, 0.0), 10)
    assert last.velocity.abs().max() < 1e-6


def test_on_the_spot_a_rover_rolls_in_its_own_tracks_for_ever() -> None:
    plant = BodyPlant(Plant([effect_of("multipass", 0.5)]), FOUR_ROVER)
    simulation = body(FOUR, plant)
    command = skid_command(FOUR, torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64))
    for _ in range(60):
        simulation.step(*command)
    assert len(simulation._tracks._trail) <= LONGEST
    assert bool((simulation._tracks.passes(simulation.wheel_places()) >= 0.0).all())


def test_in_a_turn_rear_wheels_find_less_of_a_rut_than_straight_ahead() -> None:
    sunk = []
    for twist in ((0.2, 0.0, 0.0), (0.1, 0.0, 1.0)):
        with_ruts, bare = (
            driven(plant, twist, 60).sinkage[0]
            for plant in (BodyPlant(Plant([effect_of("multipass", 2.0)]), FOUR_ROVER), None)
        )
        sunk.append((bare - with_ruts)[[1, 3]].mean() / bare[[1, 3]].mean())
    assert float(sunk[0]) > 0.3
    assert float(sunk[1]) < 0.9 * float(sunk[0])


def test_the_side_of_a_wheel_holds_a_rover_that_slides() -> None:
    plant = BodyPlant(Plant([effect_of("lateral_bulldozing", 2e5)]), FOUR_ROVER)
    held, bare = (driven(each, (0.2, 0.0, 0.6), 20) for each in (plant, None))
    assert 0.0 < float(held.velocity[0, 2]) < 0.97 * float(bare.velocity[0, 2])


def sample_of(last: BodySample, places: list[int]) -> Sample:
    level = torch.zeros_like(last.slip)
    numbers = {
        "slip": last.slip[:, places],
        "sinkage": last.sinkage[:, places],
        "torque": last.torque[:, places],
        "wheel_rate": last.rim[:, places],
    }
    scalars = ("time", "position", "height", "velocity", "acceleration", "pitch", "bogie_angle")
    flags = ("stuck", "standing")
    none = torch.zeros_like(last.time)
    values = dict.fromkeys(scalars, none) | dict.fromkeys(flags, none > 0.0)
    names = ("contact", "contact_angle", "normal", "traction", "ground_torque")
    values |= dict.fromkeys(names, level) | {"valid": level == 0.0}
    batch = len(last.time)
    soil = {
        "constants": SOIL.constants().expand(batch, 4, 6),
        "strength": SOIL.strength().expand(batch, 4, 2),
    }
    values["time"] = last.time
    return Sample(**(values | numbers | soil))


def test_sensors_of_each_side_report_as_those_of_a_planar_rover() -> None:
    """Wheels wear by axle: the second value has the front smaller than the rear."""
    effect = EFFECTS["odometry_scale"].acting(torch.tensor([[0.05, 0.5]], dtype=torch.float64))
    plant = BodyPlant(Plant([effect]), FOUR_ROVER)
    last = driven(plant, (0.2, 0.0, 0.4), 10)
    before = sample_of(last, chassis_places(FOUR_ROVER))
    after = plant.sensed(before)
    error = torch.tensor([0.05 * (1.0 + 0.5 * (w.axle - 0.5)) for w in FOUR_ROVER.wheels])
    expected = (before.slip + error.double()) / (1.0 + error.double())
    torch.testing.assert_close(after.slip, expected, rtol=0.0, atol=1e-7)
    for name in ("sinkage", "torque", "wheel_rate", "constants"):
        assert torch.equal(getattr(after, name), getattr(before, name))


@pytest.mark.parametrize("name", ["slope_bias", "sinkage_bias", "odometry_scale", "latency"])
def test_each_rover_of_a_batch_has_its_own_error_of_a_sensor(name: str) -> None:
    sizes = torch.tensor([0.0, 0.01, 0.02], dtype=torch.float64)
    effect = EFFECTS[name].acting(EFFECTS[name].values(sizes))
    plant = BodyPlant(Plant([effect]), FOUR_ROVER)
    simulation = body(FOUR, plant, batch=3)
    twists = torch.tensor([[0.2, 0.0, 0.4]], dtype=torch.float64).expand(3, -1)
    places = list(range(4))
    found = []
    for _ in range(4):
        before = sample_of(simulation.step(*skid_command(FOUR, twists)), places)
        found.append((before, plant.sensed(before)))
    before, after = found[-1]
    seen = [
        torch.cat(
            [getattr(each, signal).reshape(3, -1) for signal in ("slip", "sinkage", "pitch")], 1
        )
        for each in (before, after)
    ]
    changed = (seen[1] - seen[0]).abs().amax(1)
    assert float(changed[0]) < 1e-12
    assert 0.0 < float(changed[1]) < float(changed[2])


class Pulled(Effect):
    """A force on the body."""

    def pull(self, where: Situation) -> Pull:
        return Pull(torch.ones_like(where.velocity), torch.zeros_like(where.velocity))


def masses() -> Tensor:
    return EFFECTS["payload"].values(torch.tensor([5.0, 9.0]))


@pytest.mark.parametrize(
    "effect",
    [Pulled(), EFFECTS["payload"].acting(masses()), effect_of("contact_law_scm", 1.0)],
    ids=["force on the body", "a mass for each rover", "ruts of another law"],
)
def test_what_is_not_simulated_is_refused(effect: Effect) -> None:
    with pytest.raises(ConfigError, match="are not simulated for rovers that turn"):
        body(FOUR, BodyPlant(Plant([effect]), FOUR_ROVER), batch=2)


def test_a_payload_is_added_to_the_chassis_as_it_is() -> None:
    """Not to that of the rover file: the centre of mass has been moved, and more mass is there."""
    shifted = dataclasses.replace(FOUR, mass=60.0, centre=(0.02, -0.01, 0.3))
    loaded = body(shifted, BodyPlant(Plant([effect_of("payload", 5.0)]), FOUR_ROVER)).chassis
    assert (loaded.mass, *loaded.centre) == pytest.approx((65.0, 0.02, -0.01, 0.3))
    plain = body(shifted, BodyPlant(Plant([effect_of("grousers", 5.0)]), FOUR_ROVER)).chassis
    assert (plain.mass, *plain.centre) == pytest.approx((60.0, 0.02, -0.01, 0.3))


@pytest.mark.parametrize("size", [-50.0, -80.0])
def test_a_payload_that_leaves_no_mass_is_refused_by_name(size: float) -> None:
    plant = BodyPlant(Plant([effect_of("payload", size)]), FOUR_ROVER)
    with pytest.raises(ConfigError, match=r"four_wheel_rover, of 50 kg, a mass of .* above zero"):
        body(FOUR, plant)
