# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of rovers that turn, with a hidden effect in the nonlinear simulation, for the search."""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from studies.off_plane import KINDS, SOIL
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.runs import Blocks, Refusals, cut_by_wheel, run_of
from terrain_estimator.estimator.off_plane import SingleWheels
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.physics_of_wheels import physics_by_wheel
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.presets import load_rover
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.plant import Effect, Plant
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.spatial import BodySample, BodySimulation, Plane
from terramechanics.terrain.ground import Ground
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces, chassis_places, wheel_order

TURN = {"four_wheel_rover": 0.4, "mars_rover": 0.05}
"""[rad/s] Largest commanded yaw rate."""
CONSTANTS_OFF = 0.05
"""[1] Each soil constant is uniform within this share of the file's."""
STEEPEST = 6.0
"""[deg] of the slopes, each way."""


@dataclass(frozen=True, slots=True)
class Turning:
    """A rover and the places of its wheels."""

    kind: int  # of studies.off_plane.KINDS

    @property
    def rover(self) -> Rover:
        """The rover file."""
        return load_rover(KINDS[self.kind].rover)

    @property
    def places(self) -> WheelPlaces:
        """The places of its wheels; those of the six-wheel rover are all steered."""
        kind, rover = KINDS[self.kind], self.rover
        steered = rover.wheel_names if kind.rover == "mars_rover" else ()
        return WheelPlaces(kind.track, kind.yaw_inertia, steered)

    @property
    def nominal(self) -> Nominal:
        """The model of the search."""
        return nominal_of(self.rover, SOIL, DEFAULT_PRIOR, self.places)


SKID, STEERED = Turning(0), Turning(1)


def driven(
    turning: Turning, effect: Effect | None, drives: int, seconds: float, generator: torch.Generator
) -> tuple[list[BodySample], Tensor, BodyPlant | None]:
    """Return the samples of drives whose speed and yaw rate vary on slopes, and their strength."""
    kind, rover = KINDS[turning.kind], turning.rover
    strength = Ground.random_strength(SOIL, drives, generator).patches[0].strength
    drawn = torch.rand(12, drives, generator=generator, dtype=torch.float64)
    constants = SOIL.constants() * (1.0 + CONSTANTS_OFF * (2.0 * drawn[:6].T - 1.0))
    slopes = torch.tan(math.radians(STEEPEST) * (2.0 * drawn[6:8] - 1.0))
    frequency, phase = 0.05 + 0.1 * drawn[8:10], 2.0 * math.pi * drawn[10:12]
    chassis = Chassis.of(rover, kind.track, kind.yaw_inertia)
    plant = None if effect is None else BodyPlant(Plant([effect]), rover)
    simulation = BodySimulation(chassis, constants, strength, Plane(*slopes), effects=plant)
    samples = []
    for step in range(round(seconds / TIME_STEP)):
        faster, turn = torch.sin(2.0 * math.pi * frequency * TIME_STEP * (step + 1) + phase)
        speed = kind.speed * (1.0 + 0.3 * faster)
        twist = torch.stack([speed, torch.zeros_like(speed), TURN[kind.rover] * turn], -1)
        samples.append(simulation.step(*kind.command(chassis, twist)))
    assert bool(torch.stack([each.solved for each in samples]).all())
    return samples, strength, plant


@torch.inference_mode()
def turning_runs(
    turning: Turning, effect: Effect | None, seed: int, drives: int = 3, seconds: float = 30.0
) -> list[Blocks]:
    """Return drives with an ``effect`` in the simulation as the search reads them."""
    generator, rover = torch.Generator().manual_seed(seed), turning.rover
    samples, _, plant = driven(turning, effect, drives, seconds, generator)
    order = [chassis_places(rover)[k] for k in wheel_order(rover)]
    places, nominal = turning.places, turning.nominal
    wheels = SingleWheels(nominal.wheels, any(places.steers(rover)), rover.gravity)
    core = CoreConfig().of_model(by_wheel=True)
    physics = physics_by_wheel(rover, places, SOIL.constants().unsqueeze(0), 0.0)
    blocks = []
    for number, drive in enumerate(observed(rover, samples, order, generator, plant)):
        run = run_of(f"run_{number}", drive, rover, core, Refusals(), wheels)
        blocks.append(replace(cut_by_wheel(run, physics, nominal.row_names), soil=SOIL))
    return blocks
