# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model with named effects as further parameters beside c and tan phi.

Each value of an effect, its size and what else it has, is a parameter in prior deviations, like a
soil constant. The rows are evaluated anew at the posterior's values in every block; what they
change with each value is a difference of whole rows.
"""

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn

from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.block import BlockRows, Posterior, Solution, solve_block
from terrain_estimator.model.effects import Law, Touching, rates
from terrain_estimator.model.gaussian import mixture, project
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.prior import Prior, RoverBody
from terrain_estimator.model.rows import (
    ContactModel,
    Rows,
    frame_of,
    measured_forces,
    places,
    read_forces,
    rows_of_forces,
    values_alone,
    varied_inputs,
)
from terramechanics.contact.stresses import wheel_forces
from terramechanics.vehicle.suspension import directions

AGAIN = 3
"""Times that the rows of a block are evaluated anew at most."""
NEAR = 0.01
"""[prior deviations] Move of an effect that needs no other rows."""


class ValuePrior(nn.Module):
    """Gaussian prior of the V values of the effects, and the range in which their laws hold, [V] each."""

    mean: Tensor
    sd: Tensor
    low: Tensor
    high: Tensor

    def __init__(self, mean: Tensor, sd: Tensor, low: Tensor, high: Tensor) -> None:
        super().__init__()
        for name, value in (("mean", mean), ("sd", sd), ("low", low), ("high", high)):
            self.register_buffer(name, value)


class PAlpacaWithEffects(PAlpaca):
    """PAlpaca whose rows have named effects in them; its packed observations hold the wheel rates."""

    def __init__(
        self,
        body: RoverBody,
        constants: Tensor,
        prior: Prior,
        net: NetFeatures,
        laws: Sequence[Law],
        values: ValuePrior,
    ) -> None:
        """``values`` are those of the ``laws``, one law behind the other."""
        super().__init__(body, constants, prior, net, values.mean.shape[0])
        self.values, self.laws = values, cast("list[Law]", nn.ModuleList(laws))
        self.again, self.near = AGAIN, NEAR
        first = 0
        for law in laws:
            law.first = first
            first += law.count

    @torch.jit.export
    def effects(self, state: dict[str, Tensor]) -> Tensor:
        """Marginal posterior of the size of each of J effects over the whole bank, [J, 2]: mean and variance in SI units."""
        first = self.first_fixed - self.values.mean.shape[0]
        own = torch.eye(self.size, dtype=torch.float64)[first : self.first_fixed]
        means, covariances = project(state["mean"], state["precision"], own)
        mean, covariance = mixture(torch.log(state["weight"]), means, covariances)
        value, variance = (
            self.values.mean + self.values.sd * mean,
            self.values.sd**2 * torch.diagonal(covariance),
        )
        return torch.stack([law.size(value[law.first], variance[law.first]) for law in self.laws])

    def within(self, deviations: Tensor) -> Tensor:
        """See Physics: sizes beyond their range are linear continuations of the range's end."""
        low, high = (
            (end - self.values.mean) / self.values.sd for end in (self.values.low, self.values.high)
        )
        first = self.uncertain_constants
        return torch.cat(
            [deviations[:first], torch.minimum(torch.maximum(deviations[first:], low), high)]
        )

    def values_at(self, deviations: Tensor) -> Tensor:
        """Values [1, V] that belong to ``deviations`` [M + V] of constants and effects."""
        return (
            self.values.mean + self.values.sd * deviations[self.uncertain_constants :]
        ).unsqueeze(0)

    def varied_values(self, values: Tensor) -> Tensor:
        """Values [V, V] of which one each is a thousandth of its prior deviation larger than ``values`` [1, V]."""
        return values + 1e-3 * torch.diag(self.values.sd)

    def undone(self, packed: Tensor, values: Tensor) -> Tensor:
        """Packed observations [n, P] without what the effects with ``values`` [n or 1, V] do to sensors and drives."""
        for law in self.laws:
            packed = law.undone(packed, values[:, law.first : law.first + law.count])
        return packed

    def loaded(self, contact: ContactModel, values: Tensor) -> ContactModel:
        """The body with what the effects make of it."""
        for law in self.laws:
            contact = law.loaded(contact, values[:, law.first : law.first + law.count])
        return contact

    def forces(
        self, slip: Tensor, sinkage: Tensor, constants: Tensor, rate: Tensor, values: Tensor
    ) -> Tensor:
        """:func:`wheel_forces` with the effects in them."""
        touching = Touching(slip, sinkage, constants, torch.zeros_like(slip))
        for law in self.laws:
            touching = law.touching(touching, values[:, law.first : law.first + law.count], rate)
        forces = wheel_forces(
            touching.slip,
            touching.sinkage,
            touching.constants,
            self.radius,
            self.width,
            self.nodes,
            touching.exit_angle,
        )
        push, turn = torch.zeros_like(slip), torch.zeros_like(slip)
        for law in self.laws:
            own = values[:, law.first : law.first + law.count]
            push, turn = push + law.push(touching, own), turn + law.turn(touching, own)
        added = torch.stack([torch.zeros_like(push), push, turn], -1)
        return torch.cat([forces[..., :2], (forces[..., 2] + added).unsqueeze(-1)], -1)

    def rows_under(
        self,
        packed: Tensor,
        away: Tensor,
        contact: ContactModel,
        values: Tensor,
        doubt: Tensor | None = None,
    ) -> Rows:
        """Rows of ``packed`` with effects of these ``values`` [n or 1, V], expanded ``away`` from the inputs without them, in ``doubt``."""
        plain, contact = self.undone(packed, values), self.loaded(contact, values)
        frame = frame_of(plain, contact)
        place = places(plain + away, frame, contact)
        where = varied_inputs(place, contact)
        forces = self.forces(
            where.slip, where.sinkage, where.constants, rates(packed, self.axles), values
        )
        return rows_of_forces(
            frame, measured_forces(frame, place, read_forces(forces, where.scale, contact, doubt))
        )

    def rows(
        self,
        packed: Tensor,
        contact: ContactModel,
        deviations: Tensor,
        theta: Tensor,
        chosen: Tensor,
    ) -> Rows:
        """See Physics; the changes by the effects' values follow those by the constants."""
        values, alone = self.values_at(deviations), values_alone(contact)
        plain = self.undone(packed, values)
        straight = self.rows_under(packed, torch.zeros_like(packed), alone, values)
        agreed = agreement(straight, plain, self.loaded(alone, values), theta, chosen)
        away = agreed.inputs - plain
        rows = self.rows_under(packed, away, contact, values, agreed.doubt)
        every, n = self.varied_values(values), packed.shape[0]
        many = every.shape[0]
        varied = self.rows_under(
            packed.repeat(many, 1),
            away.repeat(many, 1),
            alone,
            every.repeat_interleave(n, 0),
            agreed.doubt.repeat(many, 1, 1),
        )
        return with_changes(rows, varied)

    def solve(
        self, before: Posterior, packed: Tensor, soil: int, expansion: Tensor
    ) -> tuple[Solution, BlockRows, Tensor]:
        """See PAlpaca; where a block moves an effect far, its rows are evaluated anew where it moved to."""
        rows, noise = self.average(packed, soil, expansion, self.every_row)
        solution = solve_block(before, rows, self.longest_step)
        first = 2 + self.uncertain_constants
        for _ in range(self.again):
            mean = torch.softmax(solution.posterior.log_weight, 0) @ solution.posterior.mean
            after = torch.cat([mean[:2], mean[self.first_constant : self.first_fixed]])
            if bool(
                (self.within(after[2:])[first - 2 :] - rows.expansion[first - 2 :]).abs().amax()
                < self.near
            ):
                break
            rows, noise = self.average(packed, soil, after, self.every_row)
            solution = solve_block(before, rows, self.longest_step)
        return solution, rows, noise

    def drive(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """See VelocityFilter; what a wrong pitch changes in the weight along the slope is in the row's constant."""
        contact = self.leading(state)
        deviations = self.within(state["expected"][self.first_constant : self.first_fixed])
        here = self.values_at(deviations)
        constants = contact.constants + contact.varied
        values = torch.cat([here.expand(constants.shape[0], -1), self.varied_values(here)])
        constants = torch.cat([constants, constants[:1].expand(here.shape[1], -1)]).unsqueeze(1)
        packed = observation.expand(values.shape[0], -1)
        plain, a = self.undone(packed, values), self.axles
        forces = (
            self.forces(plain[:, :a], plain[:, 2 * a : 3 * a], constants, rates(packed, a), values)
            * self.column_unit
        )
        along = directions(plain[:, 4 * a : 5 * a])[:, :, 0].unsqueeze(-1)
        row = (along * forces).sum([1, 2]) * self.loaded(contact, values).body_scale[..., :1]
        pitch = 8 * a + 2
        weight = self.gravity * (torch.sin(packed[:, pitch]) - torch.sin(plain[:, pitch]))
        row = torch.cat([row[:, :2], (row[:, 2] + weight).unsqueeze(1)], 1)
        return torch.cat([row[:1], 1e3 * (row[1:] - row[0])])


def with_changes(rows: Rows, varied: Rows) -> Rows:
    """``rows`` [C, n, ...] with their changes by V values, from the rows ``varied`` [1, V n, ...] by a thousandth deviation each.

    What an effect changes in a target stands, with the other sign, in the constant column.
    """
    n, r = rows.target.shape
    alike = (varied.used.view(-1, n, r) == rows.used).to(rows.used.dtype).unsqueeze(-1)
    by_target = 1e3 * (varied.target.view(-1, n, r) - rows.target)
    features = 1e3 * (varied.features.view(-1, n, r, 3) - rows.features[0])
    features = (
        torch.cat([features[..., :2], (features[..., 2] - by_target).unsqueeze(-1)], -1) * alike
    )
    noise = (
        1e3
        * (varied.noise.view(-1, n, r, rows.noise.shape[3], 3) - rows.noise[0])
        * alike.unsqueeze(-1)
    )
    return Rows(
        torch.cat([rows.features, features]),
        torch.cat([rows.noise, noise]),
        rows.target,
        rows.variance,
        rows.used,
    )
