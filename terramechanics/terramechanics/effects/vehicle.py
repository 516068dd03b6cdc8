# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects of the vehicle: its drives and its mass. Sources and ranges stand in the registry."""

from collections.abc import Callable
from typing import ClassVar

import torch
from torch import Tensor

from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP, quadrature
from terramechanics.effects.law import AddedMass, ExtraValue, Law
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.rover import Rover

NODES = quadrature()
"""For the torque that decides how a failed wheel slips."""
ROUNDS = 20
LARGEST_MOVE = 0.2
"""[1] Bound of one change of slip."""
SETTLED = 1e-9
"""[1] Move below which the next would change nothing."""


class DriveDrag(Law):
    """The motor gives size w more than the wheel needs: viscous friction of gears and seals."""

    def drive_loss(self, rate: Tensor, values: Tensor) -> Tensor:
        """Return the viscous loss; ``values`` in [N m s/rad]."""
        return values * rate


class CoulombDrag(Law):
    """The motor gives size sgn(w) more than the wheel needs: dry friction of bearings and gears."""

    def drive_loss(self, rate: Tensor, values: Tensor) -> Tensor:
        """Return the dry loss; ``values`` in [N m]."""
        return values * torch.sign(rate)


class ExtraMass(Law):
    """Mass beside the rover file's, and its moments about the rover's centre of mass."""

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("moment along the body", "kg m", 10.0),
        ExtraValue("moment of height", "kg m", 10.0),
    )

    def added_mass(self, values: Tensor) -> AddedMass | None:
        """Return mass [kg] and moments [kg m] as they stand in ``values``."""
        return AddedMass(values[:, :1], values[:, 1:])


class FailedWheel(Law):
    """The coupling of one axle's motors passes on (1 - size) of the torque of its encoder's slip.

    With 1 the wheels roll freely while motor and encoder turn as commanded, so that the slip that
    is reported is not the rim's. The rim's slip is the one at which the ground takes the torque
    that is left, at the same sinkage. A planar wheel stands for the pair on its axle. A locked
    wheel is not modelled: it is dragged below MIN_SLIP. Without an axle, the rear one fails.
    """

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.width, self.axle = rover.wheel_width, rover.axles - 1 if axle is None else axle

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Replace the axle's slip by the one at which it takes the torque that is left."""
        del rate
        here = self.order == self.axle
        failing = inputs.expanded().wheels(here)

        def torque(slip: Tensor, chosen: Tensor) -> Tensor:
            turned = failing.wheels(chosen)._replace(slip=slip)
            return turned.torque(self.radius, self.width, NODES)

        every = torch.ones_like(failing.slip, dtype=torch.bool)
        whole = torque(failing.slip[every], every).view_as(failing.slip)
        slip = _slip_under(torque, (1.0 - values) * whole, failing.slip)
        return inputs._replace(slip=torch.where(here, slip, inputs.slip))


def _slip_under(
    torque: Callable[[Tensor, Tensor], Tensor], wanted: Tensor, start: Tensor
) -> Tensor:
    """Find the slip at which ``torque`` is ``wanted``, by the secant method.

    ``torque`` returns that of the chosen wheels at the slips given for them. Torque rises less and
    less with slip. Wheels that have settled are not looked at again: most need fewer rounds than
    the slowest.
    """
    small = 1e-6
    slip = start.clamp(MIN_SLIP, MAX_SLIP)
    left = torch.ones_like(slip, dtype=torch.bool)
    here, goal = slip[left], wanted.expand_as(slip)[left]
    found = torque(here, left)
    slope = (torque(here + small, left) - found) / small
    for _ in range(ROUNDS):
        move = ((goal - found) / slope.clamp(min=1e-3)).clamp(-LARGEST_MOVE, LARGEST_MOVE)
        there = (here + move).clamp(MIN_SLIP, MAX_SLIP)
        slip[left] = there
        moved = there - here
        on = moved.abs() > SETTLED
        left[left.clone()] = on
        if not bool(on.any()):
            break
        here, goal, before = there[on], goal[on], found[on]
        found = torque(here, left)
        slope = (found - before) / moved[on]
    return slip
