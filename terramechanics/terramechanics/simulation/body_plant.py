# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects on a rover that turns: each of its sides is to an effect what a planar rover is.

Slips are those along the headings. What an effect adds to the forces fades as the rim stops, and to
traction and torque goes with the way in which it turns. A wheel has as many wheels before it as
have rolled where it is, which a turn decides (``contact.tracks``).
"""

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from terramechanics.contact.rolling import WheelMotion, compiled_rolling_forces
from terramechanics.simulation.plant import ContactInputs, Plant, Situation
from terramechanics.simulation.sample import SLOWEST, Sample
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import chassis_places

FASTEST_SLIP = 1.0
"""[1] Bound of the slip that effects see: a rim may all but stop while its hub moves on."""


def effect_inputs(
    motion: WheelMotion,
    sinkage: Tensor,
    constants: Tensor,
    strength: Tensor,
    slowest: float = SLOWEST,
    fastest_slip: float = FASTEST_SLIP,
) -> ContactInputs:
    """Return what an effect sees of wheels that roll anyhow, shapes as of ContactInputs."""
    rim = motion.rim
    way = torch.where(rim < 0.0, -1.0, 1.0).to(rim.dtype)
    slip = 1.0 - motion.along / rim.abs().clamp(min=slowest) * way
    slip = torch.where(rim.abs() / slowest < 1.0, 0.0, slip)
    aside = torch.atan2(-motion.across, motion.along.abs())
    seen = slip.clamp(-fastest_slip, fastest_slip)
    return ContactInputs(seen, sinkage, constants, strength, None, aside, None)


@dataclass(frozen=True, slots=True)
class WheelEffects:
    """The effects on the wheels of some rovers in one step."""

    plant: Plant
    where: Situation  # a row for each side of a rover, the sides of a rover after each other
    sides: int

    def rows(self, index: Tensor) -> "WheelEffects":
        """Return them for some of the rovers."""
        each = index.unsqueeze(-1) * self.sides + torch.arange(self.sides)
        return dataclasses.replace(self, where=self.where.rows(each.flatten()))

    def friction(self) -> Tensor:
        """Return the torque that the drives lose, [batch, wheels] [N m]."""
        lost = self.plant.friction(self.where)
        return lost.view(-1, self.sides * self.where.rover.axles)

    def forces(
        self,
        motion: WheelMotion,
        sinkage: Tensor,
        constants: Tensor,
        strength: Tensor,
        nodes: Tensor,
        slowest: float,
    ) -> Tensor:
        """Return N, T [N], M [N m], Y [N] of wheels [..., batch, wheels, 4].

        Shapes as of BodyStep.forces.
        """
        rover = self.where.rover
        shape = (motion.along + sinkage).shape
        folded = (*shape[:-2], shape[-2] * self.sides, rover.axles)

        def by_side(values: Tensor) -> Tensor:
            """Return [..., batch, wheels] as [..., rows, axles], trailing dimensions kept."""
            return values.reshape(folded + values.shape[len(shape) :])

        rim, along, across, depth = (
            by_side(each.expand(shape))
            for each in (motion.rim, motion.along, motion.across, sinkage)
        )
        way = torch.where(rim < 0.0, -1.0, 1.0).to(rim.dtype)
        turning = (rim.abs() / SLOWEST).clamp(max=1.0)
        inputs = effect_inputs(
            WheelMotion(rim, along, across),
            depth,
            by_side(constants.expand(*shape, 6)),
            by_side(strength.expand(*shape, 2)),
        )
        changed = self.plant.contact(self.where, inputs)
        rows = compiled_rolling_forces()(
            WheelMotion(rim, along, across), changed.sinkage, changed.constants,
            rover.wheel_radius, rover.wheel_width, nodes, changed.exit_angle, slowest,
        )  # fmt: skip
        forces = torch.matmul(rows[..., :2], inputs.strength.unsqueeze(-1)).squeeze(-1)
        forces = forces + rows[..., 2]
        one = torch.ones_like(way)
        forwards = torch.stack([one, way, way, one], -1)
        before = forces * forwards
        added = self.plant.push(self.where, changed, before) - before
        forces = forces + added * forwards * turning.unsqueeze(-1)
        return forces.reshape(*shape, 4)


class BodyPlant:
    """The effects of a simulation of rovers that turn."""

    def __init__(self, plant: Plant, rover: Rover) -> None:
        """``plant`` acts on a ``rover`` with its wheels on two sides."""
        self.plant, self._rover = plant, rover

    def begin(self, chassis: Chassis, batch: int) -> Chassis:
        """Begin a new simulation; return the ``chassis`` with the mass that effects add.

        Raises ConfigError for what is not simulated: a mass or a force on the body that differs
        from rover to rover, ruts by another law.
        """
        unloaded = dataclasses.replace(
            self._rover,
            mass=chassis.mass,
            centre_of_mass_x=chassis.centre[0],
            centre_of_mass_height=chassis.centre[2],
        )
        none = torch.zeros(batch, self._rover.axles, dtype=torch.float64)
        where = Situation(unloaded, 0.0, torch.arange(batch), none, none, none[:, 0])
        body = self.plant.body(where)
        self.plant.begin(self._rover, batch)
        parts = [
            torch.as_tensor(value, dtype=torch.float64).flatten()
            for value in (body.mass, body.x, body.height)
        ]
        mass, x, height = (float(part[0]) for part in parts)
        if not mass > 0.0:
            raise ConfigError(
                f"effect: it leaves {self._rover.name}, of {self._rover.mass:g} kg, a mass of"
                f" {mass:g} kg: it has to stay above zero"
            )
        alike = all(bool((part == part[0]).all()) for part in parts)
        if self.plant.keeps_ruts or body.outer is not None or not alike:
            raise ConfigError(
                "effect: ruts of another law, forces on the body and a mass of its own for each"
                " rover are not simulated for rovers that turn"
            )
        return dataclasses.replace(chassis, mass=mass, centre=(x, chassis.centre[1], height))

    def step(self, time: float, rim: Tensor, velocity: Tensor, passes: Tensor) -> WheelEffects:
        """Return the effects in the step to ``time`` [s].

        ``rim`` [batch, wheels] [m/s] is the command, ``velocity`` [batch] [m/s] that of the body
        ahead, and ``passes`` [batch, wheels] wheels have rolled before where each is.
        """
        axles = self._rover.axles
        sides = rim.shape[1] // axles
        rate = (rim / self._rover.wheel_radius).reshape(-1, axles)
        episode = torch.arange(rim.shape[0]).repeat_interleave(sides)
        where = Situation(
            self._rover, time, episode, torch.zeros_like(rate), rate,
            velocity.repeat_interleave(sides), passes.reshape(-1, axles),
        )  # fmt: skip
        return WheelEffects(self.plant, where, sides)

    def sensed(self, sample: Sample) -> Sample:
        """Return the sample by wheel, in the order of the rover file, that the sensors are given.

        Its shapes are [batch, ...] or [batch, times, ...].
        """
        places = torch.tensor(chassis_places(self._rover))
        order, sides = torch.argsort(places), len(places) // self._rover.axles
        time = sample.time.dim()

        def by_side(value: Tensor) -> Tensor:
            if value.dim() == time:
                return value.repeat_interleave(sides, 0)
            chosen = value.index_select(time, order)
            before, behind = value.shape[:time], value.shape[time + 1 :]
            parts = chosen.reshape(*before, sides, -1, *behind)
            return parts.movedim(time, 1).flatten(0, 1)

        def joined(value: Tensor) -> Tensor:
            both = value.reshape(-1, sides, *value.shape[1:])
            if value.dim() == time:
                return both[:, 0]
            chosen = both.movedim(1, time).flatten(time, time + 1)
            return chosen.index_select(time, places)

        names = [field.name for field in dataclasses.fields(Sample)]
        seen = self.plant.sensed(Sample(**{name: by_side(getattr(sample, name)) for name in names}))
        return Sample(**{name: joined(getattr(seen, name)) for name in names})
