# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of the soil, by other laws than the library's, where possible published ones."""

import dataclasses

import torch
from torch import Tensor

from terramechanics.simulation.plant import ContactInputs, Effect, Situation
from terramechanics.simulation.sample import Sample
from terramechanics.vehicle.rover import Rover

SOIL_DENSITY = 1600.0
"""[kg/m^3] Density of the soil."""
WEDGE_COHESION = 1000.0
"""[Pa] of the remoulded soil in front of a wheel."""
CELL = 0.05
"""[m] Length of track with one rut depth."""
CELLS = 1000
TIP_SPEED, SLOWEST = 0.05, 0.01
"""[m/s] Entry speed of the rim at which the soil constants hold, below which they stay constant."""
LUGS, LUG_WIDTH, LUG_SHIFT, LUG_ANGLES = 9, 0.25, 0.01, 12
"""Lugs of a wheel, their width by the wheel's, [m] their way through the soil that mobilises them,
and angles of the contact at which they are summed."""
MOST_DUG = 0.6
"""[1] Slip above which a wheel digs no deeper."""


def entry(contact: ContactInputs, radius: float) -> Tensor:
    """Return the angle at which the rim meets the undisturbed soil [rad]."""
    return torch.acos((1.0 - contact.sinkage / radius).clamp(0.05, 1.0))


def stiffer(contact: ContactInputs, factor: Tensor) -> ContactInputs:
    """Return the contact with k_c and k_phi times ``factor`` [rows, axles]."""
    columns = contact.constants.expand(*factor.shape, 6).unbind(-1)
    constants = torch.stack(
        [columns[0], columns[1] * factor, columns[2] * factor, *columns[3:]], dim=-1
    )
    return contact._replace(constants=constants)


class Sized(Effect):
    """An effect with one size for each episode of a batch."""

    def __init__(self, sizes: Tensor) -> None:
        self.sizes = sizes

    def size(self, where: Situation) -> Tensor:
        """Return the size of every row [rows, 1]."""
        return self.sizes[where.episode, None]


class PassiveWedge(Sized):
    """Rankine's passive earth pressure on the buried width.

    b (rho g z^2 K_p / 2 + 2 c z sqrt(K_p)) with K_p = tan^2(45 deg + phi / 2).
    """

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        tan_phi = contact.strength[..., 1]
        root = tan_phi + torch.sqrt(1.0 + tan_phi**2)  # tan(45 deg + phi / 2)
        z = contact.sinkage
        weight = SOIL_DENSITY * where.rover.gravity * z**2 * root**2 / 2.0
        force = (
            self.size(where) * where.rover.wheel_width * (weight + 2.0 * WEDGE_COHESION * z * root)
        )
        along = torch.zeros(forces.shape[-1], dtype=torch.float64)
        along[1] = 1.0
        return forces - force.unsqueeze(-1) * along


class LugThrust(Sized):
    """Bekker's thrust of lugs of height h = size: its two lug terms, mobilised with slip.

    H = b l c 2 h / b + W tan(phi) 0.64 (h / b) atan(b / h), times 1 - (K / (s l)) (1 - exp(-s l /
    K)); the moment has the arm r + h.
    """

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        r, b, h = where.rover.wheel_radius, where.rover.wheel_width, self.size(where)
        cohesion, tan_phi = contact.strength.unbind(-1)
        length = r * entry(contact, r)
        aspect = h / b
        full = 2.0 * h * length * cohesion + forces[..., 0] * tan_phi * 0.64 * aspect * torch.atan(
            1.0 / aspect.clamp(min=1e-9)
        )
        shear = (contact.slip.abs() * length / contact.constants[..., 3]).clamp(min=1e-6)
        thrust = torch.sign(contact.slip) * full * (1.0 + torch.expm1(-shear) / shear)
        added = torch.stack([torch.zeros_like(thrust), thrust, (r + h) * thrust], dim=-1)
        return forces + torch.nn.functional.pad(added, [0, forces.shape[-1] - 3])


class LugFaces(Sized):
    """Passive earth pressure on the faces of short lugs of height h = size.

    A lug at the rim angle theta pushes along the rim with LUG_WIDTH b h (K_p (rho g h / 2 + q) +
    2 c sqrt(K_p)) (1 - exp(-|j| / LUG_SHIFT)), where slip has moved it by j = r i (theta_1 - theta)
    through the soil. The surcharge q is the load over the contact, spread like a sine. The push is
    summed along the contact, each in its direction: it lifts the wheel, too. The arm of the moment
    is r + h / 2.
    """

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        r, b, h = where.rover.wheel_radius, where.rover.wheel_width, self.size(where).unsqueeze(-1)
        share = (torch.arange(LUG_ANGLES, dtype=torch.float64) + 0.5) / LUG_ANGLES
        entered, slip = entry(contact, r).unsqueeze(-1), contact.slip.unsqueeze(-1)
        theta = entered * share
        load = torch.pi / 2.0 * torch.sin(torch.pi * share) / (b * r * entered)
        surcharge = forces[..., :1].clamp(min=0.0) * load
        moved = r * slip * (entered - theta)
        cohesion, tan_phi = (each.unsqueeze(-1) for each in contact.strength.unbind(-1))
        root = tan_phi + torch.sqrt(1.0 + tan_phi**2)  # tan(45 deg + phi / 2)
        weight = SOIL_DENSITY * where.rover.gravity * h / 2.0
        passive = root**2 * (weight + surcharge) + 2.0 * cohesion * root
        lugs = LUGS / (2.0 * torch.pi) * entered / LUG_ANGLES  # at each of these angles
        mobilised = torch.sign(moved) * -torch.expm1(-moved.abs() / LUG_SHIFT)
        along = LUG_WIDTH * b * h * lugs * passive * mobilised
        parts = [
            (along * torch.sin(theta)).sum(-1),
            (along * torch.cos(theta)).sum(-1),
            ((r + h / 2.0) * along).sum(-1),
        ]
        return forces + torch.nn.functional.pad(torch.stack(parts, -1), [0, forces.shape[-1] - 3])


class Excavation(Sized):
    """Slip sinkage: the rim digs z - z_0 = z_0 size i / (1 - i), and half of that falls in again.

    That is what lugs take away on the rim's way if a share of z_0, the size, is buried of each.
    Contact begins where the soil that fell in does. That soil is loose: the pressure at the bottom
    is that of firm soil at z_0.
    """

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        slip, z = contact.slip.clamp(0.0, MOST_DUG), contact.sinkage
        firm = z / (1.0 + self.size(where) * slip / (1.0 - slip))
        reach = 0.5 * (z + firm)
        factor = (firm / reach) ** contact.constants[..., 0]
        return stiffer(contact._replace(sinkage=reach), factor)


class Rut(Sized):
    """Elastic reload in the rut of earlier wheels, of whose depth z_u a share (size) stays.

    The rim meets the soil at size z_u below the surface, and cameras see the depth from there. Down
    to z_u soil is reloaded so that at z_u the pressure is the virgin one again; deeper, the
    pressure at the bottom follows the virgin law.
    """

    def begin(self, rover: Rover, batch: int) -> None:
        self.depth = torch.zeros(
            batch, rover.axles, CELLS, dtype=torch.float64
        )  # that each axle left behind
        self.passed: Tensor | None = None  # places of the contacts at the last step
        self.offset = 1.0 - min(rover.axle_x)

    def remember(self, sample: Sample) -> None:
        cell = torch.arange(CELLS, dtype=torch.float64) * CELL - self.offset
        here = cell <= sample.contact.unsqueeze(-1)
        left = sample.sinkage.cummax(-1).values
        if self.passed is None:  # the rover came from behind, in the same way
            left = sample.sinkage[:, :1].expand_as(left)
        else:
            here = here & (cell > self.passed.unsqueeze(-1))
        self.depth = torch.where(here, left.unsqueeze(-1), self.depth)
        self.passed = sample.contact

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        rut = self._rut(where.place, where.episode)
        floor = self.size(where) * rut
        z = contact.sinkage
        reach = (z - floor).clamp(min=1e-3 * z)
        reload = (rut / (rut - floor).clamp(min=1e-9)).clamp(min=1.0)
        factor = torch.where(z > rut, z / reach, reload) ** contact.constants[..., 0]
        return stiffer(contact._replace(sinkage=reach), factor)

    def sensed(self, sample: Sample) -> Sample:
        floor = self.sizes.unsqueeze(-1) * self._rut(
            sample.contact, torch.arange(self.sizes.shape[0])
        )
        return dataclasses.replace(sample, sinkage=sample.sinkage - floor)

    def _rut(self, places: Tensor, episode: Tensor) -> Tensor:
        """Return the rut depth under each wheel [rows, axles]; none under the front wheel."""
        place = ((places[:, 1:] + self.offset) / CELL).clamp(0.0, CELLS - 2.0)
        index = place.long().unsqueeze(-1)
        depth = self.depth[episode, :-1]
        found = torch.lerp(
            depth.gather(2, index), depth.gather(2, index + 1), place.unsqueeze(-1) - index
        )
        return torch.cat([torch.zeros_like(place[:, :1]), found.squeeze(-1)], dim=1)


class PenetrationRate(Sized):
    """Rate dependence k (1 + size ln(v / v_0)), with the rim's entry speed v = r w sin(theta_1)."""

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        speed = where.speed * torch.sin(entry(contact, where.rover.wheel_radius))
        factor = (1.0 + self.size(where) * torch.log(speed.clamp(min=SLOWEST) / TIP_SPEED)).clamp(
            min=0.1
        )
        return stiffer(contact, factor)


class TrailingContact(Sized):
    """Contact behind the axle, growing with slip: theta_2 = -size theta_1 (1 + i / 2)."""

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        angle = (
            self.size(where) * entry(contact, where.rover.wheel_radius) * (1.0 + 0.5 * contact.slip)
        )
        return contact._replace(exit_angle=angle)
