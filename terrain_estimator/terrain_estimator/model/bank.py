# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The bank of hypotheses about the ground: weights, pruning and merging. Scripted with the model.

Each is a Gaussian with a kind and an age: its soil, and whether it has the net. Hypotheses of one
kind and one age are siblings: they started from one prior.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from terrain_estimator.model.block import Posterior, Solution
from terrain_estimator.model.gaussian import cholesky
from terramechanics.numerics.batching import any_of


class Bank(NamedTuple):
    """H hypotheses over D parameters."""

    mean: Tensor  # [H, D]
    covariance: Tensor  # [H, D, D]
    precision: Tensor  # [H, D, D]
    weight: Tensor  # [H] log of the weight in the mixture, up to a constant; -inf: inactive
    age: Tensor  # [H] blocks since it was started
    kind: Tensor  # [H] index of the soil, and as many more as there are soils where it has the net


class Members(NamedTuple):
    """The hypotheses of a state, before a block."""

    posterior: Posterior
    age: Tensor  # [H] blocks
    kind: Tensor  # [H]


class Solved(NamedTuple):
    """Hypotheses after a block, each with the velocities at the block's start and end."""

    solution: Solution
    age: Tensor  # [H] blocks, before the block
    kind: Tensor  # [H]


def members_of(state: dict[str, Tensor]) -> Members:
    """Return the hypotheses of a state."""
    posterior = Posterior(state["mean"], state["precision"], state["log_weight"])
    return Members(posterior, state["age"], state["kind"])


def taken(members: Members, chosen: Tensor) -> Members:
    """Return the hypotheses with the indices ``chosen``."""
    mean, precision, log_weight = members.posterior
    posterior = Posterior(mean[chosen], precision[chosen], log_weight[chosen])
    return Members(posterior, members.age[chosen], members.kind[chosen])


def restarted(solution: Solution, soil: int) -> Solved:
    """Return hypotheses on one soil, without the net, that were started anew before a block."""
    age = torch.zeros_like(solution.misfit)
    return Solved(solution, age, torch.full_like(age, soil, dtype=torch.long))


def siblings(age: Tensor, kind: Tensor) -> Tensor:
    """Return which of H hypotheses are siblings, bool [H, H]."""
    return (age.unsqueeze(1) == age) & (kind.unsqueeze(1) == kind)


def join(known: Solved, new: Solved) -> Solved:
    """Return both, one behind the other."""
    first, second = known.solution, new.solution
    posterior = Posterior(
        torch.cat([first.posterior.mean, second.posterior.mean]),
        torch.cat([first.posterior.precision, second.posterior.precision]),
        torch.cat([first.posterior.log_weight, second.posterior.log_weight]),
    )
    solution = Solution(posterior, torch.cat([first.misfit, second.misfit]))
    return Solved(solution, torch.cat([known.age, new.age]), torch.cat([known.kind, new.kind]))


def log_physical(mean: Tensor, covariance: Tensor) -> Tensor:
    """Return the log of the mass [H] of each Gaussian [H, D] on c > 0 and tan phi > 0.

    The two are taken as independent. A prior that ends at zero multiplies the evidence of a
    posterior by its mass above zero over that of its prior.
    """
    variance = torch.diagonal(covariance, dim1=-2, dim2=-1).narrow(1, 0, 2)
    mass = 0.5 * torch.special.erfc(-mean.narrow(1, 0, 2) / (2.0 * variance).sqrt())
    return torch.log(mass.clamp(min=1e-300)).sum(1)


def weigh(posterior: Posterior, age: Tensor, kind: Tensor) -> Bank:
    """Return the bank of these posteriors, weighted by their mass on physical values."""
    covariance = torch.cholesky_inverse(cholesky(posterior.precision))
    weight = posterior.log_weight + log_physical(posterior.mean, covariance)
    return Bank(posterior.mean, covariance, posterior.precision, weight, age, kind)


def take(bank: Bank, chosen: Tensor) -> Bank:
    """Return the hypotheses with the indices ``chosen``."""
    return Bank(
        bank.mean[chosen],
        bank.covariance[chosen],
        bank.precision[chosen],
        bank.weight[chosen],
        bank.age[chosen],
        bank.kind[chosen],
    )


def prune(bank: Bank, negligible: float) -> Bank:
    """Return the bank without weight where a hypothesis is ``negligible`` [nat] below the best."""
    lost = bank.weight < bank.weight.amax() - negligible
    weight = torch.where(lost, torch.full_like(bank.weight, -float("inf")), bank.weight)
    return Bank(bank.mean, bank.covariance, bank.precision, weight, bank.age, bank.kind)


def merge(bank: Bank, nearest: float) -> Bank:
    """Return the bank with siblings closer than ``nearest`` (squared Mahalanobis distance) as one.

    That one has their total weight, mean and covariance. The bank is in falling order of weight.
    The heaviest of a cluster takes the others' place, these become inactive. Hypotheses that
    started from parts of one Gaussian prior come together as the data outweigh it; where the rows
    are linear, the one that has their moments is exactly their mixture (Runnalls 2007 on merging by
    moments).
    """
    if bank.weight.shape[0] == 1:
        return bank
    active = bank.weight != -float("inf")
    index = torch.arange(bank.weight.shape[0])
    shift = bank.mean.unsqueeze(0) - bank.mean.unsqueeze(1)
    close = (
        (((shift @ bank.precision) * shift).sum(-1) < nearest)
        & siblings(bank.age, bank.kind)
        & active
        & active.unsqueeze(1)
    )
    heavier = index.unsqueeze(1) < index
    head = torch.where(close & heavier, index.unsqueeze(1), index).amin(
        0
    )  # [H] the one that each joins
    if not any_of(head != index):
        return bank
    for _ in range(4):  # the head of a chain of up to 16
        head = torch.gather(head, 0, head)
    member = head == index.unsqueeze(1)
    share = member * torch.softmax(bank.weight, 0)
    total = share.sum(1)
    grown = (member & active).sum(1) > 1
    share = share / total.clamp(min=1e-300).unsqueeze(1)
    mean = torch.where(grown.unsqueeze(1), share @ bank.mean, bank.mean)
    spread = bank.mean.unsqueeze(0) - mean.unsqueeze(1)
    moments = (share @ bank.covariance.flatten(1)).view(bank.covariance.shape) + spread.transpose(
        1, 2
    ) @ (share.unsqueeze(-1) * spread)
    wide = grown.view(-1, 1, 1)
    covariance = torch.where(wide, moments, bank.covariance)
    precision = torch.where(wide, torch.cholesky_inverse(cholesky(covariance)), bank.precision)
    weight = torch.where(
        member.diagonal(),
        torch.where(grown, torch.log(total), torch.log_softmax(bank.weight, 0)),
        -float("inf"),
    )
    return Bank(mean, covariance, precision, weight, bank.age, bank.kind)
