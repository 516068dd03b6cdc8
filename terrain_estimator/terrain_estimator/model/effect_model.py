# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model with named effects as further parameters beside c and tan phi.

Each value of an effect, its size and what else it has, is a parameter in prior deviations, like a
soil constant. The rows are evaluated anew at the posterior's values in every block; what they
change with each value is a difference of whole rows.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.block import BlockRows, Posterior, Solution, solve_block
from terrain_estimator.model.effect_rows import EffectRows, Observed, wheel_rates
from terrain_estimator.model.gaussian import mixture, project
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.prior import Prior, RoverBody
from terrain_estimator.model.rows import (
    ContactModel,
    Rows,
    values_alone,
)
from terramechanics.effects.law import Law
from terramechanics.simulation.plant import ContactInputs
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
        self.values, self.effect_rows = values, EffectRows(laws, body.mass_kg)
        self.again, self.near = AGAIN, NEAR

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
        return self.effect_rows.size_moments(value, variance)

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
        rate, strength = wheel_rates(packed, self.axles), theta[:2] * self.unit
        observed, none = Observed(packed, rate), torch.zeros_like(packed)
        straight = self.effect_rows.rows(observed, none, alone, values, strength)
        plain = self.effect_rows.corrected(observed, values)
        loaded = self.effect_rows.loaded(alone, values)
        agreed = agreement(straight, plain, loaded, theta, chosen)
        correction = agreed.inputs - plain
        rows = self.effect_rows.rows(observed, correction, contact, values, strength, agreed.doubt)
        every, n = self.varied_values(values), packed.shape[0]
        many = every.shape[0]
        varied = self.effect_rows.rows(
            Observed(packed.repeat(many, 1), rate.repeat(many, 1)),
            correction.repeat(many, 1),
            alone,
            every.repeat_interleave(n, 0),
            strength,
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
        packed, a = observation.expand(values.shape[0], -1), self.axles
        rate = wheel_rates(packed, a)
        plain = self.effect_rows.corrected(Observed(packed, rate), values)
        inputs = ContactInputs(
            plain[:, :a], plain[:, 2 * a : 3 * a], constants, state["expected"][:2] * self.unit
        )
        forces = self.effect_rows.forces(inputs, rate, contact, values) * self.column_unit
        along = directions(plain[:, 4 * a : 5 * a])[:, :, 0].unsqueeze(-1)
        scale = self.effect_rows.loaded(contact, values).body_scale[..., :1]
        row = (along * forces).sum([1, 2]) * scale
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
