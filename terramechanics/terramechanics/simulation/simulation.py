# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Longitudinal dynamics of a planar rover on deformable ground.

Steps last 0.1 s; episodes are computed in batches.
"""

import dataclasses
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import fields

import torch
from torch import Tensor

from terramechanics.contact.laws import keeps_ruts
from terramechanics.contact.ruts import REBOUND, RutMemory, Ruts, ruts_now
from terramechanics.contact.sinkage import DEEPEST, WheelGround, equilibrium_sinkage
from terramechanics.contact.stresses import in_range
from terramechanics.simulation.plant import Plant, Situation
from terramechanics.simulation.sample import SLOWEST, TIME_STEP, Drive, Sample
from terramechanics.simulation.schedules import Command, Schedule, make_profile, make_schedule
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Profile
from terramechanics.vehicle.equilibrium import Contacts, StepEquations, solve_rates, solve_torques
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import (
    BodyLoad,
    Pose,
    balance_target,
    level_pose,
    solve_pose,
    wheel_loads,
)

POINTS = 12
"""Quadrature points of the simulated forces: 2e-8 of the largest force."""
COARSE_POINTS = 3
"""Quadrature points of the Jacobian."""
STUCK_SLIP = 0.9
"""[1] Mean slip above which a rover is stuck, when it stays there."""
STUCK_TIME = 1.0
"""[s] Time after which it counts as stuck."""
LONG_STEP = 1e3
"""[s] Step that lets a drive start in its steady state."""


class Simulation:
    """Simulation of a batch of rovers; the same inputs give the same samples."""

    def __init__(
        self,
        rover: Rover,
        ground: Ground,
        profile: Profile,
        start_velocity: Tensor,
        time_step: float = TIME_STEP,
        plant: Plant | None = None,
        ruts: Ruts | None = None,
    ) -> None:
        """Start at x = 0 with ``start_velocity`` [batch] [m/s] and wheels that roll without slip.

        A step lasts ``time_step`` [s].

        ``plant`` holds the effects that act besides the nominal model. ``ruts`` are those before
        the start, where the ground keeps ruts; None: as the wheels leave it at the start. Raises
        ConfigError for a rover that is not planar.
        """
        rover.check_planar()
        batch = start_velocity.shape[0]
        self.rover, self.ground, self.profile, self.time_step, self.plant = (
            rover,
            ground,
            profile,
            time_step,
            plant,
        )
        if plant is not None:
            plant.begin(rover, batch)
        self.steps = 0
        self.velocity = start_velocity.clone()
        self.position = torch.zeros(batch, dtype=torch.float64)
        self.rate = (
            (self.velocity / rover.wheel_radius).unsqueeze(-1).expand(batch, rover.axles).clone()
        )
        self._pose = solve_pose(rover, profile, self.position, level_pose(rover, self.position))
        self._slip = torch.full_like(self.rate, 0.1)
        self._ruts: Ruts | None = None
        if keeps_ruts(ground.law) or (plant is not None and plant.keeps_ruts):
            self._ruts = ruts or RutMemory(rover.wheel_radius)
        self._find_rut(self._pose)
        self._sinkage = self._carried(
            self._pose, self._situation(self._pose, self.rate), self._slip
        )
        if self._ruts is not None and ruts is None:
            for _ in range(rover.axles):
                self._roll_in(self._slip, self._sinkage)
                where = self._situation(self._pose, self.rate)
                self._sinkage = self._carried(self._pose, where, self._slip)
        self._begin_history()
        self._struggling = torch.zeros(batch, dtype=torch.float64)
        self._stuck = torch.zeros(batch, dtype=torch.bool)

    def settle(self, command: Tensor) -> None:
        """Start in the steady state of the wheel rates ``command`` [batch, axles] [rad/s]."""
        rate = command.clamp(min=SLOWEST / self.rover.wheel_radius)
        contacts = self._contacts(self._pose, Command.RATE, rate, LONG_STEP)
        if self._ruts is not None:
            self._roll_in(contacts.slip, contacts.sinkage)
            contacts = self._contacts(self._pose, Command.RATE, rate, LONG_STEP)
        self.velocity, self._sinkage, self._slip = (
            contacts.velocity.clamp(min=0.0),
            contacts.sinkage,
            contacts.slip,
        )
        self._begin_history()
        self.rate = command.clone()

    def step(self, kind: Command, command: Tensor) -> Sample:
        """Simulate a step under ``command`` [batch, axles]: wheel rates or torques, by ``kind``."""
        self.position = self.position + self.time_step * self.velocity * torch.cos(self._pose.pitch)
        self._pose = pose = solve_pose(self.rover, self.profile, self.position, self._pose)
        self._find_rut(pose)
        lowest = SLOWEST / self.rover.wheel_radius
        contacts = self._contacts(
            pose,
            kind,
            command.clamp(min=lowest) if kind is Command.RATE else command,
            self.time_step,
        )
        velocity = contacts.velocity
        rate = command
        if kind is Command.TORQUE:
            rate = velocity.clamp(min=0.0).unsqueeze(-1) / (
                self.rover.wheel_radius * (1.0 - contacts.slip)
            )
        standing = (rate <= lowest).all(-1)
        where = self._situation(pose, rate)
        contacts = self._standing(pose, where, contacts, standing)
        # A rover that would roll back digs in and stands: backwards is outside the model.
        velocity = torch.where(standing, 0.0, velocity.clamp(min=0.0))
        self._count_struggle(contacts, velocity, standing & (kind is Command.RATE))
        sample = self._sample(pose, contacts, velocity, rate, standing)
        if self.plant is not None and where is not None:
            sample = dataclasses.replace(sample, torque=sample.torque + self.plant.friction(where))
            self.plant.remember(sample)
        self._leave_rut(pose, contacts.slip, contacts.sinkage)
        self.velocity, self.rate, self._slip, self._sinkage = (
            velocity,
            rate,
            contacts.slip,
            contacts.sinkage,
        )
        self._history.append((self._sinkage.log(), self.velocity))
        return sample

    def sensed(self, sample: Sample) -> Sample:
        """Return the latest sample as the sensors get it, before noise; call it once a step."""
        return sample if self.plant is None else self.plant.sensed(sample)

    def _situation(self, pose: Pose, rate: Tensor) -> Situation | None:
        if self.plant is None:
            return None
        time = (self.steps + 1) * self.time_step
        return Situation(
            self.rover, time, torch.arange(rate.shape[0]), pose.contact, rate, self.velocity
        )

    def _wheel(self, pose: Pose, where: Situation | None, points: int) -> WheelGround:
        return WheelGround.of(
            self.rover,
            *self.ground.at(pose.contact),
            points,
            self.plant,
            where,
            self.ground.law,
            self._rut,
        )

    def _body(self, where: Situation | None) -> BodyLoad:
        return (
            BodyLoad.of(self.rover)
            if self.plant is None or where is None
            else self.plant.body(where)
        )

    def _find_rut(self, pose: Pose) -> None:
        """Look up what the wheels before did to the ground at the wheels of this pose."""
        self._rut = None if self._ruts is None else self._ruts.at(pose.contact)

    def _leave_rut(self, pose: Pose, slip: Tensor, sinkage: Tensor) -> None:
        """Remember what the wheels do to the ground."""
        if self._ruts is not None and self._rut is not None:
            rebound = self._rebound(pose)
            self._ruts.remember(pose.contact, self._rut, slip, sinkage, rebound)

    def _rebound(self, pose: Pose) -> Tensor:
        """Return the rebound of the ground below the wheels [batch, axles] [1]."""
        if keeps_ruts(self.ground.law):
            return self.ground.at(pose.contact)[0][..., 4]
        return torch.full_like(pose.contact, REBOUND)

    def _roll_in(self, slip: Tensor, sinkage: Tensor) -> None:
        """Let the wheels have rolled up to the start with this slip and sinkage."""
        self._rut = ruts_now(slip, sinkage, self.rover.wheel_radius, self._rebound(self._pose))
        self._ruts = RutMemory(self.rover.wheel_radius)
        self._leave_rut(self._pose, slip, sinkage)

    def _contacts(self, pose: Pose, kind: Command, command: Tensor, duration: float) -> Contacts:
        where = self._situation(pose, command if kind is Command.RATE else self.rate)
        fine, coarse = (self._wheel(pose, where, points) for points in (POINTS, COARSE_POINTS))
        step = StepEquations.of(
            self.rover, pose, fine, coarse, self.velocity, duration, self._body(where)
        )
        sinkage, velocity = self._extrapolated()
        if kind is Command.TORQUE:
            to_ground = (
                command
                if self.plant is None or where is None
                else command - self.plant.friction(where)
            )
            return solve_torques(step, to_ground, sinkage, self._slip)
        return solve_rates(step, command, sinkage, velocity)

    def _begin_history(self) -> None:
        """Take the rover to have moved as it does now."""
        now = self._sinkage.log(), self.velocity
        self._history = deque([now, now, now], maxlen=3)

    def _extrapolated(self) -> tuple[Tensor, Tensor]:
        """Return sinkages [m] and velocity [m/s] one step on, by the parabola through the last.

        The imbalance from which a step is solved is then of the order of the step cubed.
        """
        (deep, fast), (deeper, faster), (depth, velocity) = self._history
        change = (2.0 * depth - 3.0 * deeper + deep).clamp(-math.log(2.0), math.log(2.0))
        return (depth + change).exp(), 3.0 * (velocity - faster) + fast

    def _carried(self, pose: Pose, where: Situation | None, slip: Tensor) -> Tensor:
        """Return the sinkages at ``slip`` under the loads of a rover without traction."""
        zero = torch.zeros_like(slip)
        load = wheel_loads(self.rover, pose, zero, zero, self._body(where))
        return equilibrium_sinkage(self._wheel(pose, where, POINTS), slip, load)

    def _standing(
        self, pose: Pose, where: Situation | None, contacts: Contacts, standing: Tensor
    ) -> Contacts:
        """Replace the contacts of standing rovers: wheels share the slope equally, without slip."""
        if not bool(standing.any()):
            return contacts
        body = self._body(where)
        still, joints = torch.zeros_like(pose.pitch), len(self.rover.suspension)
        share = balance_target(body, pose.pitch, still, joints)[..., 0] / len(self.rover.wheels)
        traction = share.unsqueeze(-1).expand_as(contacts.slip)
        torque = self.rover.wheel_radius * traction
        load = wheel_loads(self.rover, pose, traction, torque, body)
        wheel = self._wheel(pose, where, POINTS)
        zero = torch.zeros_like(load)
        held = torch.stack([load, traction, torque], dim=-1)
        here = standing.unsqueeze(-1)
        return Contacts(
            torch.where(here, zero, contacts.slip),
            torch.where(here, equilibrium_sinkage(wheel, zero, load), contacts.sinkage),
            torch.where(here.unsqueeze(-1), held, contacts.forces),
            contacts.velocity,
            contacts.solved | standing,
            contacts.obeyed & ~here,
        )

    def _count_struggle(self, contacts: Contacts, velocity: Tensor, parked: Tensor) -> None:
        slipping = contacts.slip.mean(-1) > STUCK_SLIP
        buried = (contacts.sinkage > 0.99 * DEEPEST * self.rover.wheel_radius).any(-1)
        struggles = (slipping | buried | ~contacts.solved | (velocity <= 0.0)) & ~parked
        self._struggling = torch.where(struggles, self._struggling + self.time_step, 0.0)
        self._stuck = self._stuck | (self._struggling > STUCK_TIME - self.time_step / 2.0)

    def _sample(
        self, pose: Pose, contacts: Contacts, velocity: Tensor, rate: Tensor, standing: Tensor
    ) -> Sample:
        self.steps += 1
        wheel_constants, strength = self.ground.at(pose.contact)
        normal, traction, ground_torque = contacts.forces.unbind(-1)
        undefined = standing.unsqueeze(-1)
        reach = in_range(contacts.slip, contacts.sinkage, wheel_constants, self.rover.wheel_radius)
        true_slip = 1.0 - velocity.unsqueeze(-1) / (self.rover.wheel_radius * rate)
        return Sample(
            time=torch.full_like(velocity, self.steps * self.time_step),
            position=self.position,
            height=pose.height,
            velocity=velocity,
            acceleration=(velocity - self.velocity) / self.time_step,
            pitch=pose.pitch,
            bogie_angle=pose.bogie_angle,
            stuck=self._stuck,
            standing=standing,
            slip=torch.where(undefined, math.nan, true_slip),
            sinkage=contacts.sinkage,
            contact=pose.contact,
            contact_angle=pose.contact_angle,
            wheel_rate=rate,
            torque=ground_torque + self.rover.wheel_inertia * (rate - self.rate) / self.time_step,
            normal=normal,
            traction=traction,
            ground_torque=ground_torque,
            valid=reach & contacts.obeyed & contacts.solved.unsqueeze(-1),
            constants=wheel_constants,
            strength=strength,
        )


def start(
    rover: Rover,
    ground: Ground,
    schedule: str | Schedule,
    generator: torch.Generator,
    batch: int,
    profile: str | Profile = "",
    time_step: float = TIME_STEP,
    plant: Plant | None = None,
) -> tuple[Simulation, Schedule]:
    """Make a simulation that is ready for its first step, and the schedule that drives it.

    ``schedule`` and ``profile`` are names or objects; without a profile the schedule's own is
    drawn. Named schedules of wheel rates start in their steady state, those of torques with wheels
    rolling at the start velocity.
    """
    if isinstance(profile, str):
        profile = make_profile(
            profile, schedule if isinstance(schedule, str) else "", rover, ground, batch, generator
        )
    named = isinstance(schedule, str)
    if isinstance(schedule, str):
        schedule = make_schedule(schedule, rover, ground, batch, generator)
    simulation = Simulation(rover, ground, profile, schedule.start_velocity, time_step, plant)
    if named and schedule.kind is Command.RATE:
        simulation.settle(schedule.command(0.0))
    return simulation, schedule


def simulate(
    rover: Rover,
    ground: Ground,
    schedule: str | Schedule,
    duration_s: float,
    generator: torch.Generator,
    batch: int,
    profile: str | Profile = "",
    plant: Plant | None = None,
    time_step: float = TIME_STEP,
) -> Drive:
    """Simulate a batch of drives of ``duration_s`` in steps of ``time_step``, both [s].

    They begin as by :func:`start`. The same state of the generator gives the same drives.
    """
    samples, seen = [], []
    with torch.inference_mode():  # a tenth of the time of a step is what autograd would note
        simulation, schedule = start(
            rover, ground, schedule, generator, batch, profile, time_step, plant
        )
        start_velocity = simulation.velocity
        for j in range(round(duration_s / time_step)):
            samples.append(simulation.step(schedule.kind, schedule.command((j + 1) * time_step)))
            seen.append(simulation.sensed(samples[-1]))
    # Made outside, so that a caller may differentiate what it makes of them.
    series = _series(samples)
    return Drive(rover, series, start_velocity.clone(), series if plant is None else _series(seen))


def _series(samples: Sequence[Sample]) -> Sample:
    """Stack samples in order, with a time axis behind the batch axis."""
    return Sample(
        *(
            torch.stack([getattr(sample, item.name) for sample in samples], dim=1)
            for item in fields(Sample)
        )
    )
