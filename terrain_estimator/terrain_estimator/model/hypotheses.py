# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The hypotheses about the ground: with which a drive starts, which are born on the way, which survive."""

import torch
from torch import Tensor, nn

from terrain_estimator.model.bank import (
    Bank,
    Solved,
    log_physical,
    merge,
    prune,
    shared_noise,
    take,
    weigh,
)
from terrain_estimator.model.block import Posterior, Solution
from terrain_estimator.model.gaussian import cholesky, drop, mixture, random_walk
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.prior import Prior, RoverBody
from terrain_estimator.model.velocity import OPEN, VelocityFilter
from terramechanics.numerics.batching import any_of

BANK = 9
"""Posteriors that are kept, for each soil with and without the net."""
WITH_NET = 3e-3
"""[1] Prior probability that the net has a say: the physics are believed until the data speak against them by 6 nat."""
NO_SAY = 1e12
"""[1] Precision of a net weight that leaves it at zero."""
NEGLIGIBLE = 14.0
"""[nat] A posterior whose weight is e^-14 of the best one's is dropped."""
NEAREST = 0.3
"""[1] Squared Mahalanobis distance below which kin become one."""
HAZARD = 1e-3
"""[1] Prior probability that the ground changes within one block."""
SURPRISE = 0.95
"""[1] Where the known posteriors fit a block better than this share of honest blocks would, none is born: at this quantile of
chi-square a new one that fitted like the average honest block would have a twentieth of the weight
at most, and less for its prior."""


class Hypotheses(VelocityFilter):
    """A bank of posteriors, and what is published of it."""

    offsets: Tensor
    offset_log_weight: Tensor
    offset_spread: Tensor
    born_offsets: Tensor
    born_spread: Tensor
    born_log_weight: Tensor
    other_precision: Tensor
    prior_mean: Tensor
    prior_sd: Tensor
    net_precision: Tensor
    net_log_weight: Tensor

    def __init__(
        self, body: RoverBody, constants: Tensor, prior: Prior, net: NetFeatures, added: int = 0
    ) -> None:
        """See Physics."""
        super().__init__(body, constants, prior, net, added)
        self.bank, self.negligible, self.nearest, self.no_say = (
            2 * self.known_soils * BANK,
            NEGLIGIBLE,
            NEAREST,
            NO_SAY,
        )
        self.surprise = SURPRISE
        prior_mean = [prior.cohesion_pa, prior.tan_phi]
        prior_sd = [prior.cohesion_sd_pa, prior.tan_phi_sd]
        place, weight = (
            torch.tensor([-1.2, 0.0, 1.2], dtype=torch.float64),
            torch.tensor([0.2, 0.6, 0.2], dtype=torch.float64),
        )
        self.register_buffer("offsets", torch.cartesian_prod(place, place))
        self.register_buffer("offset_log_weight", torch.cartesian_prod(weight, weight).log().sum(1))
        # with this spread, mean and variance of the mixture are exactly those of the prior
        self.register_buffer("offset_spread", (1.0 - (weight * place**2).sum()).sqrt())
        corner = torch.tensor([-0.8, 0.8], dtype=torch.float64)
        self.register_buffer("born_offsets", torch.cartesian_prod(corner, corner))
        self.register_buffer("born_spread", torch.tensor(0.6, dtype=torch.float64))  # likewise
        self.register_buffer(
            "born_log_weight", torch.tensor(HAZARD / 4.0, dtype=torch.float64).log()
        )
        other = [1.0] * (self.uncertain_constants + added) + [
            prior.mass_sd**-2,
            prior.centre_of_mass_sd**-2,
            prior.acceleration_bias_sd**-2,
            OPEN,
        ]
        self.register_buffer("other_precision", torch.tensor(other, dtype=torch.float64))
        self.register_buffer("prior_mean", torch.tensor(prior_mean, dtype=torch.float64))
        self.register_buffer("prior_sd", torch.tensor(prior_sd, dtype=torch.float64))
        self.register_buffer("net_precision", torch.ones(net.columns, dtype=torch.float64))
        # log prior probability that the plant is as the physics say, and that the net has a say
        self.register_buffer(
            "net_log_weight", torch.tensor([1.0 - WITH_NET, WITH_NET], dtype=torch.float64).log()
        )

    def commit(self, state: dict[str, Tensor], bank: Bank) -> dict[str, Tensor]:
        """The state with another bank, and its mixtures: over everything, within each soil, within the most probable one."""
        weight = torch.softmax(bank.weight, 0)
        state = state.copy()
        state["mean"], state["precision"], state["weight"] = bank.mean, bank.precision, weight
        state["log_weight"] = torch.log_softmax(bank.weight, 0) - log_physical(
            bank.mean, bank.covariance
        )
        state["age"], state["kind"] = bank.age, bank.kind
        index = torch.arange(self.known_soils)
        member = index.unsqueeze(1) == bank.kind % self.known_soils  # [K, H]
        share = weight * member
        state["soils"] = share.sum(1)
        leading = index == state["soils"].argmax()
        within = (leading.unsqueeze(1) & member).any(0)
        log_weights = torch.stack([bank.weight, torch.where(within, bank.weight, -float("inf"))])
        means, covariances = mixture(log_weights, bank.mean, bank.covariance)
        state["moments"] = torch.cat([means[:1, :2], covariances[0, :2, :2]])
        state["expected"], state["covariance"] = (
            means[1].clone(),
            covariances[1].clone(),
        )  # sums over a view may round otherwise
        apart = torch.cat(
            [bank.mean[:, :2], bank.mean[:, self.first_constant : self.first_fixed]], 1
        )
        within_soil = (share @ apart) / state["soils"].clamp(min=1e-300).unsqueeze(1)
        own = 2 + self.uncertain_constants
        nothing = torch.cat(
            [state["prior"][0], torch.zeros_like(apart[0, 2:own]), weight @ apart[:, own:]]
        )
        state["expansion"] = torch.where(state["soils"].unsqueeze(1) > 0.0, within_soil, nothing)
        chosen = leading.to(torch.float64)
        uncertain = (chosen.view(-1, 1, 1) * self.uncertain).sum(0)
        state["constants"] = (
            chosen @ self.constants + (chosen @ state["expansion"][:, 2:own]) @ uncertain
        )
        state["varied"] = (chosen.view(-1, 1, 1) * self.varied).sum(0)
        return state

    def wander(self, state: dict[str, Tensor], seconds: Tensor) -> dict[str, Tensor]:
        """Let c and tan phi of every posterior drift for the time that a block covers."""
        variance = state["prior"][2] ** 2 * seconds
        if any_of(variance > 0.0):
            state = state.copy()
            state["precision"] = random_walk(state["precision"], variance)
        return state

    def surprised(self, solution: Solution, degrees: Tensor) -> Tensor:
        """Whether a block fits the posteriors worse than a share SURPRISE of honest blocks would."""
        misfit = torch.dot(torch.softmax(solution.posterior.log_weight, 0), solution.misfit)
        return torch.special.gammainc(0.5 * degrees, 0.5 * misfit.clamp(min=0.0)) > self.surprise

    def born(self, state: dict[str, Tensor], soil: int) -> Posterior:
        """Four posteriors for ground of one soil that has just changed, without the net: all but the rover's own parameters is prior."""
        prior, expected = state["prior"], state["expected"]
        count, others = self.born_offsets.shape[0], self.size - 2 - self.kept
        theta = prior[0] + self.born_offsets * prior[1]
        mean = torch.cat(
            [
                theta,
                torch.zeros(count, others, dtype=torch.float64),
                expected[-self.kept :].expand(count, self.kept),
            ],
            1,
        )
        eye = torch.eye(self.kept, dtype=torch.float64)
        kept = torch.cholesky_solve(eye, cholesky(state["covariance"][-self.kept :, -self.kept :]))
        theta_precision = (self.born_spread * prior[1]) ** -2.0
        silent = torch.full_like(self.net_precision, self.no_say)
        fresh = torch.cat(
            [theta_precision, silent, self.other_precision[: -self.kept], torch.zeros_like(eye[0])]
        )
        precision = torch.diag(fresh) + nn.functional.pad(
            kept, [self.size - self.kept, 0, self.size - self.kept, 0]
        )
        precision = precision.expand(mean.shape[0], -1, -1)
        physical = log_physical(mean, torch.diag(1.0 / theta_precision).expand(count, -1, -1))
        return Posterior(
            mean, precision, self.born_log_weight + state["log_soils"][soil] - physical
        )

    def survive(self, solved: Solved) -> tuple[Bank, Tensor]:
        """The best of the solved posteriors without the velocity at the block's start, kin that met as one; and their misfit."""
        posterior = solved.solution.posterior
        mean, precision = drop(posterior.mean, posterior.precision, self.size - 1)
        bank = weigh(
            Posterior(mean, precision, posterior.log_weight - 0.5 * shared_noise(solved)),
            solved.age + 1.0,
            solved.kind,
        )
        kept = torch.topk(bank.weight, min(self.bank, bank.weight.shape[0]))[1]
        bank = prune(take(bank, kept), self.negligible)
        misfit = torch.dot(torch.softmax(bank.weight, 0), solved.solution.misfit[kept])
        return merge(bank, self.nearest), misfit
