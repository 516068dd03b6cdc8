# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of the vehicle."""

import torch
from torch import Tensor

from terramechanics.contact.stresses import quadrature
from terramechanics.simulation.plant import ContactInputs, Payload, Situation
from tests.hidden.soil import Sized

GREASE_RATE = 1.5
"""[rad/s] Wheel rate at which the drag of grease is size times the rate."""
BREAKAWAY_RATE = 0.4
"""[rad/s] Rate above which most of the bearings' starting friction is gone."""
DECK = (-0.2, 0.75)
"""[m] Place along the body and height of the deck that takes a load."""
NODES = quadrature(5)
STEPS = 15
NEAR, SETTLED = 1e-4, 1e-10
"""[1] Differences in slip: of the first slope, and at the end of a search."""
LOWEST, HIGHEST = -0.6, 0.95
"""[1] Range of slip of the stresses."""


class Grease(Sized):
    """Shear-thinning grease: size w_0 (w / w_0)^0.85."""

    def friction(self, where: Situation) -> Tensor:
        return self.size(where) * GREASE_RATE * (where.rate / GREASE_RATE).clamp(min=0.0) ** 0.85


class DryBearing(Sized):
    """Coulomb friction with Stribeck's rise at low rates: size (1 + exp(-(w / w_s)^2) / 2)."""

    def friction(self, where: Situation) -> Tensor:
        return self.size(where) * (1.0 + 0.5 * torch.exp(-((where.rate / BREAKAWAY_RATE) ** 2)))


class DeckLoad(Sized):
    """A load on the deck, behind and above the centre of mass."""

    def payload(self, where: Situation) -> Payload:
        mass = self.sizes[where.episode]
        return Payload(mass, torch.full_like(mass, DECK[0]), torch.full_like(mass, DECK[1]))


class WornCoupling(Sized):
    """Torque loss of one axle's coupling over a turn: size (1 - 0.05 (1 + cos(w t)))."""

    def __init__(self, sizes: Tensor, axle: Tensor) -> None:
        super().__init__(sizes)
        self.axle = axle  # [batch]
        self.lag = (
            torch.full_like(sizes, 0.05) * sizes
        )  # slip lost by the coupling when it was last asked for: a start of the search

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        turn = where.rate.mean(-1, keepdim=True) * where.time
        lost = self.size(where) * (1.0 - 0.05 * (1.0 + torch.cos(turn)))
        axles = torch.arange(where.rover.axles)
        here = (axles == self.axle[where.episode, None]).expand(contact.slip.shape)
        episode = torch.arange(where.episode.shape[0])
        axle = self.axle[where.episode]
        soil = (contact.constants[..., episode, axle, :], contact.strength[..., episode, axle, :])
        wheel = ContactInputs(
            contact.slip[..., episode, axle], contact.sinkage[..., episode, axle], *soil
        )
        rim = _slip_of_torque(wheel, where, lost.squeeze(-1), self.lag[where.episode])
        self.lag[where.episode] = (wheel.slip - rim).reshape(-1, episode.shape[0])[0]
        return contact._replace(slip=torch.where(here, rim.unsqueeze(-1), contact.slip))


def _slip_of_torque(wheel: ContactInputs, where: Situation, lost: Tensor, lag: Tensor) -> Tensor:
    """Return the slip at which the ground takes (1 - lost) of the torque, by secants."""

    def torque(slip: Tensor) -> Tensor:
        return wheel._replace(slip=slip).forces(
            where.rover.wheel_radius, where.rover.wheel_width, NODES
        )[..., 2]

    slip = (wheel.slip - lag).clamp(LOWEST, HIGHEST)
    whole, value, nearby = torque(torch.stack([wheel.slip, slip, slip + NEAR]))
    target = (1.0 - lost) * whole
    slope = (nearby - value) / NEAR
    for _ in range(STEPS):
        change = ((target - value) / slope.clamp(min=1e-6)).clamp(-0.15, 0.15)
        after = (slip + change).clamp(LOWEST, HIGHEST)
        if float(change.abs().max()) < SETTLED:
            return after
        before, value = value, torque(after)
        moved = after - slip
        slope = torch.where(moved.abs() > SETTLED, (value - before) / moved, slope)
        slip = after
    return slip
