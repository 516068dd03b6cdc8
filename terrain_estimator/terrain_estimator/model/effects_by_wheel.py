# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Named effects in the rows of single wheels, for exported models and for the search alike.

An effect does what the simulator of rovers that turn does with it
(``terramechanics.simulation.body_plant``): each side of the rover is to an effect on sensors and
drives what a planar rover is, and an effect in the contact sees the slip along the heading.
"""

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn

from terrain_estimator.model.body_motion import body_motion
from terrain_estimator.model.effect_rows import EffectRows, Observed, readings_of, with_readings
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.rows import ContactModel
from terramechanics.contact.rolling import WheelMotion, rolling_forces
from terramechanics.effects.law import Law, Readings
from terramechanics.effects.sensing import OdometryScale
from terramechanics.simulation.body_plant import effect_inputs
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WIDEST_SLIP


class EffectsByWheel(nn.Module):
    """Effects on the wheels of a rover; their values [n or 1, V] follow one another.

    It is called as :class:`~terrain_estimator.model.physics_by_wheel.RollingForces`.
    """

    def __init__(self, laws: Sequence[Law], rover: Rover) -> None:
        """``laws`` are those of the effects on this ``rover``."""
        super().__init__()
        wide = [of_wheels(law) for law in laws]
        self.laws = cast("list[Law]", nn.ModuleList(wide))
        self.rows = EffectRows(wide, rover.mass)
        self.counts, self.sides = [law.count for law in laws], rover.wheels_per_axle
        self.wheels, self.radius = len(rover.wheels), rover.wheel_radius

    def corrected(self, packed: Tensor, values: Tensor) -> Tensor:
        """Return packed observations [n, P] without the effects on sensors and drives."""
        rate = body_motion(view_of(packed, self.wheels)).rim / self.radius
        readings = folded(readings_of(Observed(packed, rate)), self.sides)
        if values.shape[0] > 1:
            values = values.repeat_interleave(self.sides, 0)
        readings = self.rows.corrected_readings(readings, values)
        return with_readings(packed, unfolded(readings, self.sides))

    def forward(
        self,
        motion: WheelMotion,
        rim: Tensor,
        sinkage: Tensor,
        constants: Tensor,
        contact: ContactModel,
        values: Tensor | None,
    ) -> Tensor:
        """Return the forces with the effects in the contact, [..., n, W, 4, 3]."""
        given = torch.zeros_like(rim[:1, :0]) if values is None else values
        own = given.split_with_sizes(self.counts, 1)
        # no law by wheel reads the strength of the ground
        strength = torch.zeros_like(constants[..., :2])
        inputs = effect_inputs(motion, sinkage, constants, strength)
        for k, law in enumerate(self.laws):
            inputs = law.contact(inputs, own[k], rim / contact.radius)
        forces = rolling_forces(
            motion, inputs.sinkage, inputs.constants, contact.radius, contact.width, contact.nodes,
            inputs.exit_angle,
        )  # fmt: skip
        none = torch.zeros_like(forces[..., 0, 0])
        # A law pushes a wheel that drives forwards; backwards it acts the other way.
        way = torch.where(motion.rim < 0.0, -1.0, 1.0).to(none.dtype) + none
        one = torch.ones_like(none)
        forwards = torch.stack([one, way, way, one], -1).unsqueeze(-1)
        before = forces * forwards
        changed = before
        for k, law in enumerate(self.laws):
            changed = law.under_load(changed, inputs, own[k])
        turning = (motion.rim * way).unsqueeze(-1).unsqueeze(-1)
        forces = forces + (changed - before) * forwards * turning
        traction, torque, side = none, none, none
        for k, law in enumerate(self.laws):
            added = law.added_force(inputs, own[k])
            if added is not None:
                traction = traction + added.traction * motion.rim
                torque = torque + added.torque * motion.rim
                lateral = added.lateral
                if lateral is not None:
                    side = side + lateral
        sums = torch.stack([none, traction, torque, side], -1)
        return torch.cat([forces[..., :2], (forces[..., 2] + sums).unsqueeze(-1)], -1)


def of_wheels(law: Law) -> Law:
    """Return a law for single wheels, whose slips reach further than those of a planar rover."""
    if isinstance(law, OdometryScale):
        law.lowest, law.highest = -WIDEST_SLIP, WIDEST_SLIP
    return law


def by_side(values: Tensor, sides: int) -> Tensor:
    """Return values [n, W] of wheels in ``wheel_order`` as those [n sides, A] of planar rovers."""
    return values.unflatten(1, [-1, sides]).transpose(1, 2).flatten(0, 1)  # type: ignore[no-untyped-call]


def by_wheel(values: Tensor, sides: int) -> Tensor:
    """Return values [n sides, A] as they were before :func:`by_side`."""
    return values.unflatten(0, [-1, sides]).transpose(1, 2).flatten(1, 2)  # type: ignore[no-untyped-call]


def folded(readings: Readings, sides: int) -> Readings:
    """Return the readings of n rovers with wheels on ``sides`` as those of planar rovers."""
    return Readings(
        by_side(readings.slip, sides),
        by_side(readings.slip_sd, sides),
        by_side(readings.sinkage, sides),
        by_side(readings.torque, sides),
        readings.pitch.repeat_interleave(sides, 0),
        readings.acceleration.repeat_interleave(sides, 0),
        by_side(readings.wheel_rate, sides),
    )


def unfolded(readings: Readings, sides: int) -> Readings:
    """Return readings as they were before :func:`folded`."""
    return Readings(
        by_wheel(readings.slip, sides),
        by_wheel(readings.slip_sd, sides),
        by_wheel(readings.sinkage, sides),
        by_wheel(readings.torque, sides),
        readings.pitch[::sides],
        readings.acceleration[::sides],
        by_wheel(readings.wheel_rate, sides),
    )
