# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate the reference drives by which a configuration's sensors are judged."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from terrain_estimator.learning.observing import observations_of, observed
from terrain_estimator.model.metadata import Metadata
from terrain_estimator.observation import Observation
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import STUCK_SLIP, STUCK_TIME, simulate
from terramechanics.simulation.spatial import BodySample, BodySimulation
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.profile import STEEPEST
from terramechanics.terrain.soil import Soil
from terramechanics.terrain.surface import random_waves
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.steering import partly_steered_command
from terramechanics.vehicle.suspension import TerrainError
from terramechanics.vehicle.wheel_places import WheelPlaces, chassis_places, wheel_order

SEED = 1
SECONDS = 40.0
"""[s] Length of a drive, that of docs/bring_your_own_sensors.md."""
SCHEDULE = "S1"
"""Over hills, with every sensor of the simulator."""
BENDS = 20.0
"""[s] From one bend to the left to the next, with one to the right between."""
WIDE = 2.0
"""[1] Radius of the sharpest bend, in units of the rover's length or of its track width."""
STARTING = 2.0
"""[s] Time in which a rover that turns reaches its speed."""

Drives = dict[str, list[Observation]]


def measured_drives(metadata: Metadata, seconds: float = SECONDS) -> Drives:
    """Return what a model's rover measures on each of its soils, with the prior's c and tan phi.

    A soil on which the rover gets stuck has no drive: that is not for its sensors to help. There is
    none for wheels that do not fit between the hills. Takes seconds.
    """
    try:
        if metadata.wheel_places is None:
            return _straight(metadata, seconds)
        return _turning(metadata, metadata.wheel_places, metadata.soils, seconds)
    except TerrainError:
        return {}


def _straight(metadata: Metadata, seconds: float) -> Drives:
    generator, soils = torch.Generator().manual_seed(SEED), metadata.soils
    constants, strength = _ground(metadata, soils)
    ground = Ground([Patch(constants, strength, name=soils[0].name, law=soils[0].law)])
    drive = simulate(metadata.rover, ground, SCHEDULE, seconds, generator, len(soils))
    measured = measure_drive(metadata.rover, drive.seen, Noise(), generator)
    stuck = drive.sample.stuck.any(1).tolist()
    return {
        soil.name: observations_of(measured, index)
        for index, soil in enumerate(soils)
        if not stuck[index]
    }


def _turning(
    metadata: Metadata, places: WheelPlaces, soils: Sequence[Soil], seconds: float
) -> Drives:
    """Return the drives by wheel over hills, straight ahead for a third of the time, else in bends.

    Where the rover gets stuck on a soil, the others begin anew without it: to search for the
    balances of a stuck rover would take minutes.
    """
    if not soils:
        return {}
    rover, generator = metadata.rover, torch.Generator().manual_seed(SEED)
    chassis = Chassis.of(rover, places.track_width, places.yaw_inertia)
    in_chassis = chassis_places(rover)
    steered = torch.zeros(chassis.wheels, dtype=torch.bool)
    for place, name in zip(in_chassis, rover.wheel_names, strict=True):
        steered[place] = name in places.steered
    surface = random_waves(len(soils), STEEPEST, generator)
    simulation = BodySimulation(chassis, *_ground(metadata, soils), surface=surface)
    driven: list[BodySample] = []
    for step in range(1, round(seconds / TIME_STEP) + 1):
        speed, turn = _motion(rover, places, step * TIME_STEP).expand(len(soils), 2).unbind(1)
        driven.append(simulation.step(*partly_steered_command(chassis, speed, turn, steered)))
        if any(stuck := _stuck(driven).tolist()):
            freed = [soil for soil, held in zip(soils, stuck, strict=True) if not held]
            return _turning(metadata, places, freed, seconds)
    order = [in_chassis[wheel] for wheel in wheel_order(rover)]
    drives = observed(rover, driven, order, generator)
    return {soil.name: drive for soil, drive in zip(soils, drives, strict=True)}


def _ground(metadata: Metadata, soils: Sequence[Soil]) -> tuple[Tensor, Tensor]:
    """Return constants [soils, 6] and the strength [soils, 2] of the prior."""
    constants = torch.stack([soil.constants() for soil in soils])
    return constants, torch.tensor([metadata.prior_mean] * len(soils), dtype=torch.float64)


def _motion(rover: Rover, places: WheelPlaces, time: float) -> Tensor:
    """Return the commanded speed [m/s] and yaw rate [rad/s] of a rover that turns, [2]."""
    varied = 1.0 + 0.3 * math.sin(2.0 * math.pi * time / (0.6 * BENDS))
    speed = min(time / STARTING, 1.0) * varied * sum(rover.cruise_speed) / 2.0
    wave = math.sin(2.0 * math.pi * time / BENDS)
    bend = math.copysign(max(0.0, 2.0 * abs(wave) - 1.0), wave)
    radius = WIDE * max(rover.axle_x[0] - rover.axle_x[-1], places.track_width)
    return torch.tensor([speed, bend * speed / radius], dtype=torch.float64)


def _stuck(driven: list[BodySample]) -> Tensor:
    """Return which drives [drives] stay at the slip of a stuck rover, or have no solution now."""
    steps = round(STUCK_TIME / TIME_STEP)
    slip = torch.stack([sample.slip.mean(-1) for sample in driven[-steps:]])
    held = (slip > STUCK_SLIP).all(0) & (len(slip) == steps)
    return held | ~driven[-1].solved
