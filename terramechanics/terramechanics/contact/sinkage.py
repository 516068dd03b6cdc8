# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Quasi-static equilibria of single wheels: sinkage under a load, slip under a torque."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from terramechanics.contact.scm import Rut
from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP, quadrature
from terramechanics.numerics.roots import bracketed_root
from terramechanics.simulation.plant import ContactInputs, Plant, Situation
from terramechanics.terrain.soil import WONG_REECE
from terramechanics.vehicle.rover import Rover

SHALLOWEST = 1e-7
"""[1] Smallest sinkage that is looked for, in wheel radii."""
DEEPEST = 0.95
"""[1] Deepest sinkage that is looked for, in wheel radii."""
Excess = Callable[[Tensor], Tensor]
FEW = 200
"""Number of wheels below which it does not pay to treat braked wheels apart."""
ITERATIONS = 60
"""Bisections of a safeguarded search: more than float64 can tell apart."""
_nodes = cache(quadrature)
"""Nobody writes into these; to find them anew took a tenth of a step of one rover."""


@dataclass(frozen=True, slots=True)
class WheelGround:
    """Wheels of a rover and the ground below each, on which their forces depend."""

    radius: float
    width: float
    constants: Tensor  # [..., 6] in the order of CONSTANTS
    strength: Tensor  # [..., 2] c [Pa] and tan(phi) [1]
    nodes: Tensor  # quadrature(points)
    plant: Plant | None = None  # what acts besides the nominal model
    where: Situation | None = None  # what that depends on; there if a plant is
    slip_angle: Tensor | None = (
        None  # [...] [rad] see Contact; None: the wheels move along their heading
    )
    law: str = WONG_REECE  # contact law by name
    rut: Rut | None = None  # [...] of the wheels before; None: fresh ground

    @classmethod
    def of(
        cls,
        rover: Rover,
        constants: Tensor,
        strength: Tensor,
        points: int,
        plant: Plant | None = None,
        where: Situation | None = None,
        law: str = WONG_REECE,
        rut: Rut | None = None,
    ) -> "WheelGround":
        """Make the wheels of ``rover``; ``points`` is the number of quadrature nodes a side.

        The law scm divides its contact into more pieces, with half as many in each.
        """
        nodes = _nodes(points if law == WONG_REECE else (points + 1) // 2)
        return cls(
            rover.wheel_radius, rover.wheel_width, constants, strength, nodes, plant, where,
            None, law, rut,
        )  # fmt: skip

    def forces(self, slip: Tensor, sinkage: Tensor) -> Tensor:
        """Return N, T [N] and M [N m] of one wheel, shape [..., 3].

        At a slip angle the shape is [..., 4], with the lateral force [N].
        """
        contact = ContactInputs(
            slip, sinkage, self.constants, self.strength, slip_angle=self.slip_angle, rut=self.rut
        )
        if self.plant is None or self.where is None:
            return self._integrated(contact)
        contact = self.plant.contact(self.where, contact)
        return self.plant.push(self.where, contact, self._integrated(contact))

    def _integrated(self, contact: ContactInputs) -> Tensor:
        braked = contact.slip < 0.0
        if braked.numel() < FEW or not bool(braked.any()):
            return contact.forces(self.radius, self.width, self.nodes, self.law)
        # Braked wheels need twice the nodes: do not let a few of them make all the others pay.
        contact = contact.expanded()
        forces = contact.slip.new_empty(*contact.slip.shape, 3 if contact.slip_angle is None else 4)
        braked = contact.slip < 0.0
        for part in (braked, ~braked):
            chosen = contact.wheels(part)
            forces[part] = chosen.forces(self.radius, self.width, self.nodes, self.law)
        return forces

    def rows(self, index: Tensor) -> "WheelGround":
        """Return these wheels for some of the episodes."""
        where = None if self.where is None else self.where.rows(index)
        angle = None if self.slip_angle is None else self.slip_angle[index]
        return WheelGround(
            self.radius,
            self.width,
            self.constants[index],
            self.strength[index],
            self.nodes,
            self.plant,
            where,
            angle,
            self.law,
            None if self.rut is None else Rut(*(part[index] for part in self.rut)),
        )


def equilibrium_sinkage(
    wheel: WheelGround, slip: Tensor, load: Tensor, start: Tensor | None = None
) -> Tensor:
    """Return the sinkage [m] at which one wheel carries ``load`` [N] at ``slip``; shapes [...].

    N rises with z nearly like a power of z, so this is Newton in logarithms, kept in a bracket by
    bisection. A load that is not positive gives the shallowest, one that no depth carries the
    deepest sinkage of the search. ``start`` [m] is where the search begins.
    """
    low = torch.full_like(load, SHALLOWEST * wheel.radius).log()
    high = torch.full_like(load, DEEPEST * wheel.radius).log()
    depth = (
        torch.full_like(load, 0.03 * wheel.radius).log()
        if start is None
        else start.log().clamp(low, high)
    )
    ends = wheel.forces(slip.expand(2, *slip.shape), torch.stack([low, high]).exp())[..., 0]
    floats, drowns = load <= ends[0], load >= ends[1]
    depth = torch.where(floats, low, torch.where(drowns, high, depth))
    target = load.clamp(min=1e-9).log()
    small = 1e-6
    for _ in range(ITERATIONS):
        pair = torch.stack([depth, depth + small])
        normal = wheel.forces(slip.expand_as(pair), pair.exp())[..., 0].clamp(min=1e-12).log()
        gap = normal[0] - target
        low, high = torch.where(gap < 0.0, depth, low), torch.where(gap < 0.0, high, depth)
        newton = depth - gap * small / (normal[1] - normal[0])
        done = (gap.abs() < 1e-12) | (high - low < 1e-13) | floats | drowns
        if bool(done.all()):
            break
        inside = (newton > low) & (newton < high)
        depth = torch.where(done, depth, torch.where(inside, newton, (low + high) / 2.0))
    return depth.exp()


def slip_under_torque(
    wheel: WheelGround, torque: Tensor, load: Tensor, start: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Return slip [1] and sinkage [m] of a wheel under a load [N] and a torque [N m]; shapes [...].

    M rises with slip at constant load. A torque beyond what the ground can take ends at MAX_SLIP,
    one below at MIN_SLIP.
    """
    return _slip_search(wheel, load, start, lambda forces: forces[..., 2] - torque)


def free_rolling(wheel: WheelGround, load: Tensor) -> tuple[Tensor, Tensor]:
    """Return slip [1] and sinkage [m] of a wheel without traction (T = 0) under ``load`` [N]."""
    return _slip_search(wheel, load, None, lambda forces: forces[..., 1])


def drawbar_capability(rover: Rover, constants: Tensor, strength: Tensor) -> Tensor:
    """Return the largest T / N [1] below 60 % slip: [batch, 6], [batch, 2] -> [batch].

    The wheel is evenly loaded, on level ground.
    """
    wheel = WheelGround.of(rover, constants.unsqueeze(-2), strength.unsqueeze(-2), points=8)
    slip = torch.linspace(0.1, 0.6, 6, dtype=torch.float64).expand(strength.shape[0], -1)
    load = torch.full_like(slip, rover.weight / len(rover.wheels))
    forces = wheel.forces(slip, equilibrium_sinkage(wheel, slip, load))
    return (forces[..., 1] / forces[..., 0]).amax(-1)


def _slip_search(
    wheel: WheelGround, load: Tensor, start: Tensor | None, excess: Excess
) -> tuple[Tensor, Tensor]:
    """Return the slip at which ``excess``, which rises with slip, is zero under the load."""
    depth = start

    def trial(slip: Tensor) -> Tensor:
        nonlocal depth
        depth = equilibrium_sinkage(wheel, slip, load, depth)
        return excess(wheel.forces(slip, depth))

    slip = bracketed_root(
        trial, torch.full_like(load, MIN_SLIP), torch.full_like(load, MAX_SLIP), tolerance=1e-11
    )
    return slip, equilibrium_sinkage(wheel, slip, load, depth)
