# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The physics of a rover on some soils: contact models and the rows of a block."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.block import LINK_VARIANCE, BlockRows, block_rows, fixed_columns
from terrain_estimator.model.packing import PackedView, view_of
from terrain_estimator.model.rows import (
    MOMENT_VARIANCE,
    PA_PER_UNIT,
    ContactModel,
    Rows,
    balances_of,
    drive_row,
    frame_of,
    rows_at,
    values_alone,
)
from terrain_estimator.model.stencil import Stencil, stencil
from terrain_estimator.model.unmeasured import (
    lacks_sinkage,
    with_balanced_sinkage,
    without_sinkage,
)
from terramechanics.contact.stresses import in_range, quadrature
from terramechanics.numerics.batching import any_of
from terramechanics.terrain.soil import CONSTANTS
from terramechanics.vehicle.suspension import Geometry

UNCERTAIN = ("n", "k_phi", "shear_modulus", "c1", "c2")
"""Soil constants that can be parameters.

k_c acts through the stiffness k_c / b + k_phi alone, so k_phi carries both.
"""
NEAR = (0.05, 0.01)
"""[kPa, 1] Move of c and tan phi that needs no other rows, where a sinkage is missing."""
NEAR_CONSTANTS = 0.3
"""[prior deviations] Move of a soil constant that needs no other rows.

Rows are linear in the constants and forces are not: the load is convex in n. In the first second
the constants move by up to two deviations.
"""
GEOMETRY = ("axle_x", "centre", "pivot", "carried")
"""Names of the tensors of a model that the rover file gives."""


def uncertain_constants(constants: Tensor, relative_sd: float, width: float) -> Tensor:
    """Return prior deviations [K, M, 6] of the constants UNCERTAIN of K soils [K, 6].

    Each of the six is known to ``relative_sd`` [1]. M = 0 where that is zero.
    """
    if relative_sd == 0.0:
        return torch.zeros(constants.shape[0], 0, 6, dtype=torch.float64)
    sd = relative_sd * constants
    sd[:, 2] = torch.hypot(sd[:, 1] / width, sd[:, 2])
    return torch.diag_embed(sd)[:, [CONSTANTS.index(name) for name in UNCERTAIN]]


class RoverBody(NamedTuple):
    """The numbers of a rover that the rows need."""

    rows: tuple[str, ...]  # names of the R rows
    axles: int  # or wheels, where these are estimated one by one
    wheels_per_axle: int
    mass_kg: float
    gravity: float  # [m/s^2]
    radius_m: float
    width_m: float
    geometry: Geometry


class SoilRows(NamedTuple):
    """The rows of a block on one soil."""

    rows: BlockRows
    noise: Tensor  # [n, E, 3] of the velocity row of each observation


class Physics(nn.Module):
    """Features and noise of the rows, for every soil that the model knows."""

    uncertain: Tensor
    varied: Tensor
    constants: Tensor
    nodes: Tensor
    stencil_moves: Tensor
    stencil_constants: Tensor
    stencil_weights: Tensor
    stencil_curvature: Tensor
    stand_in: Tensor
    body_scale: Tensor
    axle_x: Tensor
    centre: Tensor
    pivot: Tensor
    carried: Tensor
    fixed_columns: Tensor
    column_unit: Tensor

    def __init__(self, body: RoverBody, constants: Tensor, constants_sd: float) -> None:
        """Take a rover and the constants [K, 6] of the K soils that the model knows.

        They are in the order of terramechanics.terrain.soil.CONSTANTS. Where ``constants_sd``
        [1] is above 0 each is a parameter of the posterior, in prior deviations.
        """
        super().__init__()
        self.axles, self.gravity = body.axles, body.gravity
        self.radius, self.width = body.radius_m, body.width_m
        self.near, self.near_constants = NEAR, NEAR_CONSTANTS
        self.moment_variance, self.link_variance = MOMENT_VARIANCE, LINK_VARIANCE
        self.known_soils, self.effect_values = constants.shape[0], 0
        uncertain = uncertain_constants(constants, constants_sd, body.width_m)
        self.uncertain_constants = uncertain.shape[1]
        # Buffers, not literals in the methods: TorchScript rounds the numbers of
        # torch.tensor([...]) to float32.
        self.register_buffer("constants", constants)
        self.register_buffer("uncertain", uncertain)
        varied = torch.cat([torch.zeros_like(constants).unsqueeze(1), 1e-3 * uncertain], 1)
        self.register_buffer("varied", varied)
        self.register_buffer("nodes", quadrature())
        for name, values in zip(Stencil._fields, stencil(self.uncertain_constants), strict=True):
            self.register_buffer(f"stencil_{name}", values)
        units = torch.tensor([PA_PER_UNIT, 1.0, 1.0], dtype=torch.float64)
        self.register_buffer("column_unit", units)
        self._register_body(body)

    def _register_body(self, body: RoverBody) -> None:
        """Keep the numbers of the rover that the rows need."""
        by_mass = body.wheels_per_axle / body.mass_kg
        by_weight = body.wheels_per_axle / (body.mass_kg * body.gravity)
        wheelbase = float(body.geometry.axle_x[0] - body.geometry.axle_x[-1])
        moments = [by_weight / wheelbase] * (1 + body.geometry.carried.shape[0])
        scale = torch.tensor([by_mass, by_weight, *moments], dtype=torch.float64)
        self.register_buffer("body_scale", scale)
        self.register_buffer("fixed_columns", fixed_columns(body.rows, wheelbase))
        wheel = [0.1, 0.01, 0.01 * body.radius_m, 1e-3 * body.radius_m, 0.0, 0.0, 0.0, 0.0]
        self.register_buffer("stand_in", torch.tensor(wheel, dtype=torch.float64).unsqueeze(1))
        for name in GEOMETRY:
            self.register_buffer(name, getattr(body.geometry, name))

    def contact(self, soil: int, deviations: Tensor) -> ContactModel:
        """Return the contact model of a soil with these ``deviations`` [M or more]."""
        known = deviations[: self.uncertain_constants]
        return self.contact_of(
            self.constants[soil] + known @ self.uncertain[soil], self.varied[soil]
        )

    def contact_of(self, constants: Tensor, varied: Tensor) -> ContactModel:
        """Return the contact model of ``constants`` [6] and their changes ``varied`` [C, 6]."""
        differences = Stencil(
            self.stencil_moves, self.stencil_constants, self.stencil_weights, self.stencil_curvature
        )
        geometry = Geometry(self.axle_x, self.centre, self.pivot, self.carried, self.radius)
        return ContactModel(
            constants, varied, differences, self.nodes, self.column_unit, geometry,
            self.body_scale, self.moment_variance, self.stand_in, self.gravity, self.radius,
            self.width,
        )  # fmt: skip

    def nominal_contact(self, soil: int = 0) -> ContactModel:
        """Return the contact model of a soil with its constants as given."""
        return self.contact_of(self.constants[soil], self.varied[soil])

    def constants_of(self, chosen: Tensor, deviations: Tensor) -> tuple[Tensor, Tensor]:
        """Return the constants [6] of the ``chosen`` soil and their changes [C, 6].

        ``chosen`` [K] is 1 or 0, ``deviations`` are [K, M].
        """
        by_soil = chosen.view(-1, 1, 1)
        uncertain = (by_soil * self.uncertain).sum(0)
        constants = chosen @ self.constants + (chosen @ deviations) @ uncertain
        return constants, (by_soil * self.varied).sum(0)

    def supposed(self, sinkage: Tensor) -> Tensor:
        """Return ``sinkage`` [..., W] [m] with a harmless one where it is missing."""
        return torch.where(torch.isnan(sinkage), 0.01 * self.radius, sinkage)

    def in_every_range(self, slip: Tensor, sinkage: Tensor) -> Tensor:
        """Return which wheels [n, W] are in the range of every soil with its nominal constants."""
        constants, sinkage = self.constants.view(-1, 1, 1, 6), self.supposed(sinkage)
        return in_range(slip, sinkage, constants, self.radius).all(0)

    def usable(self, view: PackedView, leading: Tensor) -> Tensor:
        """Return which wheels [W] of one observation are measured and in range.

        That is the range of every soil, and of the ``leading`` constants [6]. A sinkage may be
        missing.
        """
        constants = leading.view(1, 1, 6)
        if self.known_soils > 1:
            constants = torch.cat([constants, self.constants.unsqueeze(1)])
        sinkage = self.supposed(view.sinkage)
        possible = in_range(view.slip, sinkage, constants, self.radius).all(0)
        return possible & (view.contact_angle.abs() < float("inf"))

    def balanced(
        self, view: PackedView, constants: Tensor, varied: Tensor, strength: Tensor
    ) -> PackedView:
        """Return one observation with the sinkages that the balances ask for, if one is missing.

        ``constants`` [6] and ``varied`` [C, 6] as in :meth:`drive_row`; ``strength`` [2] is
        (c [kPa], tan phi).
        """
        packed = view.packed.unsqueeze(0)
        if not any_of(lacks_sinkage(packed, self.axles)):
            return view
        contact = values_alone(self.contact_of(constants, varied))
        theta = torch.cat([strength, torch.ones_like(strength[:1])])
        return view_of(with_balanced_sinkage(packed, contact, theta)[0], self.axles)

    def drive_row(
        self, view: PackedView, constants: Tensor, varied: Tensor, deviations: Tensor
    ) -> Tensor:
        """Return the velocity row of one observation and its changes, as rows.drive_row does.

        ``constants`` [6] are those of the soil with all ``deviations``, ``varied`` [C, 6] their
        changes.
        """
        del deviations
        contact = self.contact_of(constants, varied)
        return drive_row(view.slip, view.sinkage, view.contact_angle, contact)

    def rows(self, packed: Tensor, contact: ContactModel, theta: Tensor, chosen: Tensor) -> Rows:
        """Return the rows of observations [n, P], expanded where the ``chosen`` [R] agree best.

        ``theta`` [3] is (c [kPa], tan phi, 1). Missing sinkages are those that the balances ask
        for at ``theta``.
        """
        missing = lacks_sinkage(packed, self.axles)
        if any_of(missing):
            return self.rows_without_sinkage(packed, missing, contact, theta, chosen)
        frame = frame_of(packed, contact)
        agreed = agreement(
            rows_at(frame, packed, values_alone(contact)), packed, contact, theta, chosen
        )
        return rows_at(frame, agreed.inputs, contact, agreed.doubt)

    def rows_without_sinkage(
        self, packed: Tensor, missing: Tensor, contact: ContactModel, theta: Tensor, chosen: Tensor
    ) -> Rows:
        """Return what :meth:`rows` does, without the sinkages of observations [n] that lack one."""
        alone = values_alone(contact)
        balanced = with_balanced_sinkage(packed, alone, theta)
        frame = frame_of(balanced, contact)
        straight = without_sinkage(rows_at(frame, balanced, alone), missing, theta)
        agreed = agreement(straight, balanced, contact, theta, chosen)
        rows = rows_at(frame, agreed.inputs, contact, agreed.doubt)
        return without_sinkage(rows, missing, theta)

    def average(
        self, packed: Tensor, learnt: Tensor, soil: int, expansion: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Return the rows of a block [n, P] on a soil.

        Args:
            packed: observations [n, P].
            learnt: net columns of their rows [n, R, net].
            soil: index of the soil.
            expansion: (c [kPa], tan phi, deviations of the constants) [2 + M] at which the rows are
                evaluated.
            chosen: 1 for the rows that may be used, 0 for others [R].
        """
        deviations = expansion[2:]
        contact = self.contact(soil, deviations)
        theta = torch.cat([expansion[:2], torch.ones_like(expansion[:1])])
        rows = self.rows(packed, contact, theta, chosen)
        return self.averaged(rows, packed, learnt, deviations, chosen)

    def averaged(
        self, rows: Rows, packed: Tensor, learnt: Tensor, deviations: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Return the mean of the ``rows`` of a block [n, P] at ``deviations`` [M or more]."""
        rows = Rows(
            rows.features, rows.noise, rows.target, rows.variance, rows.used * chosen, rows.taken
        )
        view = view_of(packed, self.axles)
        velocity = torch.stack([view.velocity, view.velocity_sd**2], 1)
        # the net needs every wheel
        columns = torch.where(rows.used[:, :1].unsqueeze(-1) > 0.0, learnt, 0.0)
        if rows.taken.shape[2] > 0:
            columns = columns - rows.taken @ balances_of(columns, 1, self.axles)
        step = view.step * rows.used[:, 0]
        averaged = block_rows(
            rows, columns, step, velocity, deviations, self.fixed_columns, self.link_variance
        )
        return SoilRows(averaged, rows.noise[0, :, 0])

    def has_moved(self, packed: Tensor, before: Tensor, after: Tensor) -> Tensor:
        """Return whether a block [n, P] needs other rows, bool [].

        ``before`` and ``after`` are as ``expansion`` in :meth:`average`. Rows without a sinkage are
        curved in (c, tan phi), all rows in the soil constants.
        """
        cohesion, friction = (after[:2] - before[:2]).abs().unbind(0)
        strength = (cohesion >= self.near[0]) | (friction >= self.near[1])
        strength = strength & lacks_sinkage(packed, self.axles).any()
        return strength | self.constants_moved(before, after)

    def constants_moved(self, before: Tensor, after: Tensor) -> Tensor:
        """Return whether a soil constant moved so far that other rows are needed, bool []."""
        moved = (after - before)[2 : 2 + self.uncertain_constants].abs()
        return (moved >= self.near_constants).any()

    def effect_sizes(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Return the moments [J, 2] of the sizes of J = 0 named effects."""
        return torch.stack([mean, variance], 1)
