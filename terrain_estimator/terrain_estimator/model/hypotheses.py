# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The hypotheses about the ground: the first ones, those started anew, and the selection."""

import torch
from torch import Tensor, nn

from terrain_estimator.model.bank import (
    Bank,
    Solved,
    log_physical,
    merge,
    prune,
    take,
    weigh,
)
from terrain_estimator.model.block import Posterior, Solution
from terrain_estimator.model.gaussian import cholesky, drop, mixture, random_walk
from terrain_estimator.model.parameters import FIRST_LEARNT, ParameterLayout
from terrain_estimator.model.prior import Prior
from terrain_estimator.model.rows import PA_PER_UNIT
from terrain_estimator.model.velocity import OPEN
from terramechanics.numerics.batching import any_of

BANK = 9
"""Posteriors that are kept for each soil; where there is a net, as many more with it."""
WITH_NET = 3e-3
"""[1] Prior probability of the net: the physics hold until the data contradict them by 6 nat."""
ZERO_PRECISION = 1e12
"""[1] Precision of a net weight that leaves it at zero."""
ALIKE = 1.0 - 1e-9
"""[1] Share of the largest probability from which two soils are equally probable."""
NEGLIGIBLE = 14.0
"""[nat] A posterior whose weight is e^-14 of the best one's is dropped."""
FARTHEST = 3.0
"""[prior deviations] Soil constants at which rows are evaluated at most."""
NEAREST = 0.3
"""[1] Squared Mahalanobis distance below which siblings become one."""
HAZARD = 1e-3
"""[1] Prior probability that the ground changes within one block."""
SURPRISE = 0.95
"""[1] Share of honest blocks that fit worse than one at which no hypothesis is started anew.

At this quantile of chi-square a new one that fitted like the average honest block would have a
twentieth of the weight at most, and less for its prior.
"""


class Hypotheses(nn.Module):
    """The rules of a bank of posteriors; the bank itself is in the state."""

    layout: ParameterLayout
    offsets: Tensor
    offset_log_weight: Tensor
    offset_spread: Tensor
    restart_offsets: Tensor
    restart_spread: Tensor
    restart_log_weight: Tensor
    rover_precision: Tensor
    prior_mean: Tensor
    prior_sd: Tensor
    net_precision: Tensor
    net_log_weight: Tensor
    unit: Tensor

    def __init__(self, prior: Prior, layout: ParameterLayout, soils: int) -> None:
        """Take the prior, the order of the parameters and the number K of known soils."""
        super().__init__()
        self.layout, self.known_soils = layout, soils
        self.choices = 1 if layout.first_constant == FIRST_LEARNT else 2  # with the net, too
        self.bank = self.choices * soils * BANK
        self.negligible, self.nearest, self.surprise = NEGLIGIBLE, NEAREST, SURPRISE
        self.zero_precision, self.alike, self.farthest = ZERO_PRECISION, ALIKE, FARTHEST
        # Buffers, not literals in the methods: TorchScript rounds the numbers of
        # torch.tensor([...]) to float32.
        place = torch.tensor([-1.2, 0.0, 1.2], dtype=torch.float64)
        weight = torch.tensor([0.2, 0.6, 0.2], dtype=torch.float64)
        self.register_buffer("offsets", torch.cartesian_prod(place, place))
        self.register_buffer("offset_log_weight", torch.cartesian_prod(weight, weight).log().sum(1))
        # with this spread, mean and variance of the mixture are exactly those of the prior
        self.register_buffer("offset_spread", (1.0 - (weight * place**2).sum()).sqrt())
        corner = torch.tensor([-0.8, 0.8], dtype=torch.float64)
        self.register_buffer("restart_offsets", torch.cartesian_prod(corner, corner))
        # likewise
        self.register_buffer("restart_spread", torch.tensor(0.6, dtype=torch.float64))
        log_hazard = torch.tensor(HAZARD / 4.0, dtype=torch.float64).log()
        self.register_buffer("restart_log_weight", log_hazard)
        for name, values in (
            ("rover_precision", [*_rover_precision(prior), OPEN]),
            ("prior_mean", [prior.cohesion_pa, prior.tan_phi]),
            ("prior_sd", [prior.cohesion_sd_pa, prior.tan_phi_sd]),
            ("net_precision", [1.0] * (layout.first_constant - FIRST_LEARNT)),
            ("unit", [PA_PER_UNIT, 1.0]),
        ):
            self.register_buffer(name, torch.tensor(values, dtype=torch.float64))
        # log prior probability of the physics alone, and of the net beside them
        trust = [1.0] if self.choices == 1 else [1.0 - WITH_NET, WITH_NET]
        self.register_buffer("net_log_weight", torch.tensor(trust, dtype=torch.float64).log())

    def first(self, state: dict[str, Tensor]) -> Bank:
        """Return the first bank: on each soil a grid over the prior, without a net and with it."""
        mean, sd = state["prior_mean"], state["prior_sd"]
        start = torch.zeros(
            self.known_soils, self.offsets.shape[0], self.layout.size, dtype=torch.float64
        )
        start[:, :, :2] = mean + self.offsets * sd
        start = start.flatten(0, 1).repeat(self.choices, 1)
        kind = torch.arange(self.choices * self.known_soils)
        kind = kind.repeat_interleave(self.offsets.shape[0])
        strength = (self.offset_spread * sd) ** -2.0
        without_net = torch.full_like(self.net_precision, self.zero_precision)
        precisions = [self.diagonal(strength, without_net, self.rover_precision)]
        if self.choices > 1:
            precisions.append(self.diagonal(strength, self.net_precision, self.rover_precision))
        precision = torch.stack(precisions)
        precision = precision.repeat_interleave(start.shape[0] // self.choices, 0)
        age = torch.full((start.shape[0],), 1e9, dtype=torch.float64)
        bank = weigh(Posterior(start, precision, age), age, kind)
        # so that the mixture is exactly the prior, whatever it puts on negative c or tan phi
        weight = (
            self.net_log_weight.view(-1, 1, 1)
            + state["log_soils"].unsqueeze(1)
            + self.offset_log_weight
        ).flatten()
        return Bank(bank.mean, bank.covariance, bank.precision, weight, age, kind)

    def diagonal(self, strength: Tensor, net: Tensor, rover: Tensor) -> Tensor:
        """Return the precision [D, D] of independent parameters, 1 for constants and effects."""
        layout = self.layout
        others = layout.size - layout.first_constant - rover.shape[0]
        return torch.diag(torch.cat([strength, net, torch.ones(others, dtype=net.dtype), rover]))

    def diffuse(self, state: dict[str, Tensor], seconds: Tensor) -> dict[str, Tensor]:
        """Return the state after c and tan phi of every posterior drifted for ``seconds`` []."""
        variance = state["random_walk"] ** 2 * seconds
        if any_of(variance > 0.0):
            state = state.copy()
            state["precision"] = random_walk(state["precision"], variance)
        return state

    def active_soils(self, state: dict[str, Tensor]) -> Tensor:
        """Return the soil [H] of each hypothesis, -1 for one of no weight."""
        active = state["log_weight"] != -float("inf")
        return torch.where(active, state["kind"] % self.known_soils, -1)

    def surprised(self, solution: Solution, degrees: Tensor) -> Tensor:
        """Return whether a block fits worse than a share SURPRISE of honest blocks."""
        misfit = torch.dot(torch.softmax(solution.posterior.log_weight, 0), solution.misfit)
        return torch.special.gammainc(0.5 * degrees, 0.5 * misfit.clamp(min=0.0)) > self.surprise

    def restart(self, state: dict[str, Tensor], soil: int) -> Posterior:
        """Return four posteriors for ground of one soil that has just changed, without the net.

        All but the rover's own parameters is the prior.
        """
        mean, sd, first = state["prior_mean"], state["prior_sd"], self.layout.first_effect
        count, own = self.restart_offsets.shape[0], self.layout.size - first
        strength = (self.restart_spread * sd) ** -2.0
        start = torch.cat(
            [
                mean + self.restart_offsets * sd,
                torch.zeros(count, first - 2, dtype=torch.float64),
                state["expected"][first:].expand(count, own),
            ],
            1,
        )
        eye = torch.eye(own, dtype=torch.float64)
        rover = torch.cholesky_solve(eye, cholesky(state["covariance"][first:, first:]))
        without_net = torch.full_like(self.net_precision, self.zero_precision)
        ground = self.diagonal(strength, without_net, torch.zeros_like(eye[0]))
        precision = (ground + nn.functional.pad(rover, [first, 0, first, 0])).expand(count, -1, -1)
        physical = log_physical(start, torch.diag(1.0 / strength).expand(count, -1, -1))
        log_weight = self.restart_log_weight + state["log_soils"][soil] - physical
        return Posterior(start, precision, log_weight)

    def select(self, solved: Solved) -> tuple[Bank, Tensor]:
        """Return the best of the solved posteriors, and the misfit [] of the block.

        The velocity at the block's start is marginalised, siblings that met are one, and those that
        go have no weight.
        """
        posterior = solved.solution.posterior
        mean, precision = drop(posterior.mean, posterior.precision, self.layout.size - 1)
        bank = weigh(
            Posterior(mean, precision, posterior.log_weight), solved.age + 1.0, solved.kind
        )
        kept = torch.topk(bank.weight, min(self.bank, bank.weight.shape[0]))[1]
        bank = prune(take(bank, kept), self.negligible)
        misfit = torch.dot(torch.softmax(bank.weight, 0), solved.solution.misfit[kept])
        return merge(bank, self.nearest), misfit

    def publish(self, state: dict[str, Tensor], bank: Bank) -> dict[str, Tensor]:
        """Return the state with another bank and its mixtures.

        These are over everything, within each soil, and within the most probable one.
        """
        weight = torch.softmax(bank.weight, 0)
        member = self.members(bank.kind)
        share = weight * member
        soils = share.sum(1)
        within = (self.leading(soils).unsqueeze(1) & member).any(0)
        log_weights = torch.stack([bank.weight, torch.where(within, bank.weight, -float("inf"))])
        means, covariances = mixture(log_weights, bank.mean, bank.covariance)
        state = state.copy()
        state["mean"], state["precision"], state["weight"] = bank.mean, bank.precision, weight
        state["age"], state["kind"], state["soils"] = bank.age, bank.kind, soils
        state["log_weight"] = torch.log_softmax(bank.weight, 0) - log_physical(
            bank.mean, bank.covariance
        )
        state["strength_mean"], state["strength_covariance"] = means[0, :2], covariances[0, :2, :2]
        # clones, because sums over a view may round otherwise
        state["expected"], state["covariance"] = means[1].clone(), covariances[1].clone()
        state["expansion"] = self.expansion(bank.mean, weight, share, soils, state["prior_mean"])
        return state

    def members(self, kind: Tensor) -> Tensor:
        """Return which of the hypotheses [H] are on each soil, bool [K, H]."""
        return torch.arange(self.known_soils).unsqueeze(1) == kind % self.known_soils

    def leading(self, soils: Tensor) -> Tensor:
        """Return which soil is the most probable one, bool [K]."""
        return torch.arange(self.known_soils) == self.most_probable(soils)

    def most_probable(self, soils: Tensor) -> Tensor:
        """Return the index [] of the most probable of ``soils`` [K], probabilities.

        Of soils alike it is the first, also where their sums were rounded in another order.
        """
        return (soils >= self.alike * soils.amax()).to(torch.float64).argmax()

    def places(self, mean: Tensor) -> Tensor:
        """Return where rows of hypotheses with this ``mean`` [H, D] are evaluated [H, 2 + M + V].

        That is at (c [kPa], tan phi), the soil constants and the effects. Beyond FARTHEST rows are
        continued linearly: on a soil that is not the true one constants move so far that no wheel
        could drive with them.
        """
        layout = self.layout
        constants = mean[:, layout.first_constant : layout.first_effect]
        return torch.cat(
            [
                mean[:, :2],
                constants.clamp(-self.farthest, self.farthest),
                mean[:, layout.first_effect : layout.first_fixed],
            ],
            1,
        )

    def expansion(
        self, mean: Tensor, weight: Tensor, share: Tensor, soils: Tensor, prior: Tensor
    ) -> Tensor:
        """Return the values [K, 2 + M + V] at which the next block's rows are evaluated.

        Args:
            mean: of each hypothesis [H, D].
            weight: of each [H].
            share: the same on its soil, zero on others [K, H].
            soils: probability of each soil [K].
            prior: mean of (c [kPa], tan phi) [2].
        """
        layout = self.layout
        values, own = self.places(mean), 2 + layout.constants
        within = (share @ values) / soils.clamp(min=1e-300).unsqueeze(1)
        without = torch.cat([prior, torch.zeros_like(values[0, 2:own]), weight @ values[:, own:]])
        return torch.where(soils.unsqueeze(1) > 0.0, within, without)


def _rover_precision(prior: Prior) -> list[float]:
    """Return the prior precision of mass, centre of mass and acceleration bias."""
    return [prior.mass_sd**-2, prior.centre_of_mass_sd**-2, prior.acceleration_bias_sd**-2]
