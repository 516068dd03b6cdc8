# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The physics of a rover on some soils as a TorchScript module: what the rows need, and the rows of a block."""

import torch
from torch import Tensor, nn

from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.block import FIXED, LINK_VARIANCE, BlockRows, block_rows, fixed_columns
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.packing import packed_size
from terrain_estimator.model.prior import Prior, RoverBody, uncertain_constants
from terrain_estimator.model.rows import (
    MOMENT_VARIANCE,
    PA_PER_UNIT,
    ContactModel,
    Rows,
    frame_of,
    row_names,
    rows_at,
    values_alone,
)
from terrain_estimator.model.stencil import Stencil, stencil
from terramechanics.contact.stresses import in_range, quadrature
from terramechanics.vehicle.suspension import Geometry

KEPT = FIXED - 1
"""Parameters of the rover, not of the ground: mass, centre of mass, acceleration bias, velocity; named effects besides."""


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
    fixed_columns: Tensor
    every_row: Tensor
    unit: Tensor
    column_unit: Tensor

    def __init__(
        self, body: RoverBody, constants: Tensor, prior: Prior, net: NetFeatures, added: int = 0
    ) -> None:
        """``constants`` [K, 6] are those of the K soils that the model knows, as in terramechanics.contact.stresses.CONSTANTS.

        Where ``prior.constants_sd`` is above 0 each of them is a parameter of the posterior, in
        prior deviations. So are ``added`` values of named effects, which follow the constants and
        stay when the ground changes.
        """
        super().__init__()
        self.prior = prior  # for the metadata; the scripted module has the buffers
        self.axles, self.gravity, self.radius, self.width = (
            body.axles,
            body.gravity,
            body.radius_m,
            body.width_m,
        )
        uncertain = uncertain_constants(constants, prior.constants_sd, body.width_m)
        self.known_soils, self.first_constant = constants.shape[0], 2 + net.columns
        self.uncertain_constants, self.kept = uncertain.shape[1], added + KEPT
        self.first_fixed = self.first_constant + uncertain.shape[1] + added
        self.size = self.first_fixed + KEPT
        self.observation_size = packed_size(body.axles, rates=added > 0)
        self.moment_variance, self.link_variance = MOMENT_VARIANCE, LINK_VARIANCE
        self.net = net
        by_mass, by_weight = (
            body.wheels_per_axle / body.mass_kg,
            body.wheels_per_axle / (body.mass_kg * body.gravity),
        )
        wheelbase = float(body.geometry.axle_x[0] - body.geometry.axle_x[-1])
        by_moment = by_weight / wheelbase
        # Buffers, not literals in the methods: TorchScript rounds the numbers of
        # torch.tensor([...]) to float32.
        self.register_buffer("uncertain", uncertain)
        self.register_buffer(
            "varied", torch.cat([torch.zeros_like(constants).unsqueeze(1), 1e-3 * uncertain], 1)
        )
        wheel = [0.1, 0.01, 0.01 * body.radius_m, 1e-3 * body.radius_m, 0.0, 0.0, 0.0, 0.0]
        self.register_buffer("stand_in", torch.tensor(wheel, dtype=torch.float64).unsqueeze(1))
        self.register_buffer("constants", constants)
        self.register_buffer("nodes", quadrature())
        for name, values in zip(Stencil._fields, stencil(self.uncertain_constants), strict=True):
            self.register_buffer(f"stencil_{name}", values)
        self.register_buffer(
            "body_scale",
            torch.tensor([by_mass, by_weight, by_moment, by_moment], dtype=torch.float64),
        )
        self.register_buffer("axle_x", body.geometry.axle_x)
        self.register_buffer("centre", body.geometry.centre)
        self.register_buffer("pivot", body.geometry.pivot)
        self.register_buffer("fixed_columns", fixed_columns(body.axles, wheelbase))
        self.register_buffer(
            "every_row", torch.ones(len(row_names(body.axles)), dtype=torch.float64)
        )
        self.register_buffer("unit", torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64))
        self.register_buffer(
            "column_unit", torch.tensor([PA_PER_UNIT, 1.0, 1.0], dtype=torch.float64)
        )

    def contact(self, soil: int, deviations: Tensor) -> ContactModel:
        """The physics that the rows need, for the constants of a soil and their ``deviations`` [M or more] from the nominal ones."""
        constants = (
            self.constants[soil] + deviations[: self.uncertain_constants] @ self.uncertain[soil]
        )
        return self.physics(constants, self.varied[soil])

    def leading(self, state: dict[str, Tensor]) -> ContactModel:
        """The same for the most probable soil and its expected constants."""
        return self.physics(state["constants"], state["varied"])

    def physics(self, constants: Tensor, varied: Tensor) -> ContactModel:
        """The same for given constants."""
        differences = Stencil(
            self.stencil_moves, self.stencil_constants, self.stencil_weights, self.stencil_curvature
        )
        geometry = Geometry(self.axle_x, self.centre, self.pivot, self.radius)
        return ContactModel(
            constants, varied, differences, self.nodes, self.column_unit, geometry,
            self.body_scale, self.moment_variance, self.stand_in, self.gravity, self.radius, self.width,
        )  # fmt: skip

    def nominal_contact(self, soil: int = 0) -> ContactModel:
        """The same with the soil constants as given."""
        return self.physics(self.constants[soil], self.varied[soil])

    def in_every_range(self, wheels: Tensor) -> Tensor:
        """Wheels [n, A] of packed groups [n, 8, A] that are in the range of every soil with its nominal constants."""
        return in_range(
            wheels[:, 0], wheels[:, 2], self.constants.view(-1, 1, 1, 6), self.radius
        ).all(0)

    def usable_by_all(self, wheels: Tensor, leading: Tensor) -> Tensor:
        """Wheels [A] of one packed group [8, A] that are measured and in the range of every soil and of the ``leading`` constants [6]."""
        constants = leading.view(1, 1, 6)
        if self.known_soils > 1:
            constants = torch.cat([constants, self.constants.unsqueeze(1)])
        return in_range(wheels[0], wheels[2], constants, self.radius).all(0) & (
            wheels[4].abs() < float("inf")
        )

    def learnt(self, packed: Tensor) -> Tensor:
        """Net features [n, R, net] of packed observations [n, 8 A + 9]."""
        a = self.axles
        slip, _, sinkage, _, angle, rest = packed.split_with_sizes(
            [a, a, a, a, a, packed.shape[1] - 5 * a], 1
        )
        return self.net(slip, sinkage, angle, rest.narrow(1, 3 * a + 2, 1))

    def within(self, deviations: Tensor) -> Tensor:
        """Where rows are evaluated for these expected ``deviations`` [M]."""
        return deviations

    def rows(
        self,
        packed: Tensor,
        contact: ContactModel,
        deviations: Tensor,
        theta: Tensor,
        chosen: Tensor,
    ) -> Rows:
        """Rows of packed observations where those that are ``chosen`` agree best, given ``theta`` [3]."""
        del deviations
        frame = frame_of(packed, contact)
        agreed = agreement(
            rows_at(frame, packed, values_alone(contact)), packed, contact, theta, chosen
        )
        return rows_at(frame, agreed.inputs, contact, agreed.doubt)

    def average(
        self, packed: Tensor, soil: int, expansion: Tensor, chosen: Tensor
    ) -> tuple[BlockRows, Tensor]:
        """Rows of a block on a soil, those ``chosen`` [R] (1 or 0), and the noise of its velocity rows [n, E, 3].

        ``expansion`` [2 + M] is (c [kPa], tan phi, deviations of the constants, of named effects)
        for which they are evaluated.
        """
        deviations = self.within(expansion[2:])
        contact, theta = (
            self.contact(soil, deviations),
            torch.cat([expansion[:2], torch.ones_like(expansion[:1])]),
        )
        rows = self.rows(packed, contact, deviations, theta, chosen)
        rows = Rows(rows.features, rows.noise, rows.target, rows.variance, rows.used * chosen)
        measured = packed[:, 8 * self.axles :]
        velocity = torch.stack([measured[:, 0], measured[:, 1] ** 2], 1)
        columns = torch.where(
            rows.used[:, :1].unsqueeze(-1) > 0.0, self.learnt(packed), 0.0
        )  # needs every wheel
        step = measured[:, -2] * rows.used[:, 0]
        averaged = block_rows(
            rows, columns, step, velocity, deviations, self.fixed_columns, self.link_variance
        )
        return averaged, rows.noise[0, :, 0]
