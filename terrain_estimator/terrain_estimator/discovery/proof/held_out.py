# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A held-out run in two halves, each predicted with the ground that the other half gives.

c, tan phi, the soil constants and the accelerometer's bias are a run's own, so they have to be
fitted to something: to the half that is not being judged. The sizes of effects are never fitted
here, they come from other runs.
"""

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.contributions import ContributionTask
from terrain_estimator.discovery.hypotheses.equations import Equations, Query
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.leftover.flexible import no_columns
from terrain_estimator.discovery.runs import PIECE, Blocks, RunError

SHORTEST_HALF = 8
"""[blocks] of a half of a run: eight seconds."""


@dataclass(frozen=True, slots=True)
class Model:
    """A hypothesis with the sizes that other runs gave."""

    hypothesis: Hypothesis
    values: Tensor  # [K] as ``Fit.point.shared``
    covariance: Tensor  # [K, K]


@dataclass(frozen=True, slots=True)
class GroundEstimate:
    """The ground of a half of a run, under one model."""

    unknowns: Unknowns  # the velocities are that half's
    # [P + K, P + K] of theta, soil constants, bias and sizes, by the sensors' stated noise
    covariance: Tensor


@dataclass(frozen=True, slots=True)
class Half:
    """A half of a run, and the ground that the other half gives under each model."""

    blocks: Blocks
    grounds: tuple[GroundEstimate, ...]


def long_enough(run: Blocks) -> Blocks:
    """Return the run where it can be halved.

    Raises:
        RunError: it is too short, or a half has no piece without a gap that is long enough for a
            rollout.
    """
    count = len(run.packed)
    if count < 2 * SHORTEST_HALF:
        raise RunError(
            f"{run.name}: {count} whole seconds, a held-out run needs at least {2 * SHORTEST_HALF}"
        )
    if not all(half.pieces(PIECE) for half in halved(run)):
        raise RunError(
            f"{run.name}: a held-out run needs {PIECE} s in one piece in each half, there are gaps"
            " everywhere"
        )
    return run


def halved(run: Blocks) -> tuple[Blocks, Blocks]:
    """Return both halves of a run."""
    count = len(run.packed)
    return run.between(0, count // 2), run.between(count // 2, count)


def equations_of(nominal: Nominal, half: Half, number: int, model: Model) -> Equations:
    """Return the equations of a half at the ground of the other one, with all velocities at zero.

    ``number`` is that of the ``model``.
    """
    other = half.grounds[number].unknowns
    columns = no_columns([half.blocks]).columns[0]
    mask = torch.ones(columns.shape[1] - 1, dtype=torch.float64)
    velocity = torch.zeros(half.blocks.velocities, dtype=torch.float64)
    there = dataclasses.replace(other, velocity=velocity)
    none = torch.zeros(0, dtype=torch.float64)
    query = Query(
        there, tuple(model.values.tolist()), none, columns, model.hypothesis.shared().step, None
    )
    return ContributionTask(nominal, model.hypothesis, mask)(half.blocks, query)
