# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The whole recursion over many drives at once."""

from typing import NamedTuple

import torch
from torch import Tensor

from studies.recursion.blocks import BlockMaker, LiftedRows
from studies.recursion.lift import BODY, CONSTANTS, lift
from studies.recursion.readout import PriorOf, refine
from studies.recursion.statistic import (
    Sources,
    Statistic,
    Velocity,
    added,
    block_score,
    empty_statistic,
    masked,
    open_velocity,
    sources_of,
    velocity_after,
    weights_of,
)
from terrain_estimator.model.packed_observation import BLOCK
from terrain_estimator.model.packing import without_link
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_with_effects import nominal_of

RUNNING_STEPS = 2
"""Gauss-Newton steps after each block, for the weights of the next."""


class RecursionVariant(NamedTuple):
    """One way to run the recursion."""

    mask: Tensor  # [Q] of the block's rows
    told: float  # 1: instruments corrected by the residual, 0: the columns themselves


class Running(NamedTuple):
    """The state of one variant."""

    statistic: Statistic
    velocity: Velocity
    sources: Sources  # of the last whole block, from which the weights follow
    k: Tensor  # [G, SIZE] estimate at present


def prior_of(model: PAlpaca) -> PriorOf:
    """Return the model's prior of (c [kPa], tan phi), the constants in deviations, and body."""
    own = model.hypotheses
    mean = torch.cat([own.prior_mean / own.unit, torch.zeros(CONSTANTS + BODY).double()])
    strength = (own.prior_sd / own.unit) ** -2.0
    constants = torch.ones(CONSTANTS, dtype=torch.float64)
    return PriorOf(mean, torch.cat([strength, constants, own.rover_precision[:BODY]]))


def maker_of(model: PAlpaca) -> BlockMaker:
    """Return the maker of blocks with the constants of a model of one soil."""
    physics = nominal_of(model.physics)
    return BlockMaker(physics.nominal_contact(), physics.uncertain[0], physics.link_variance)


def block_mask(rows: Tensor) -> Tensor:
    """Return the mask [Q] of a block's rows for that of the observations' rows [R]."""
    return torch.cat([rows[:1], rows])


def run(
    model: PAlpaca,
    packed: Tensor,
    ends: Tensor,
    variants: list[RecursionVariant],
    blocks: list[int],
) -> list[list[Statistic]]:
    """Run the variants over packed drives [N, T, P], of which the first ``ends`` [N] count.

    Returns the statistics of each variant after each number of ``blocks``.
    """
    maker, prior = maker_of(model), prior_of(model)
    packed = torch.cat([without_link(packed[:, :1]), packed[:, 1:]], 1)
    found: list[list[Statistic]] = [[] for _ in variants]

    def rows_of(j: int) -> LiftedRows:
        place = torch.arange(j * BLOCK, (j + 1) * BLOCK)
        return maker.rows(packed[:, place], (place < ends.unsqueeze(1)).to(packed.dtype))

    with torch.inference_mode():
        now, after = rows_of(0), rows_of(1)
        running = [_start(after, variant, prior) for variant in variants]
        for j in range(max(blocks)):
            for index, variant in enumerate(variants):
                running[index] = _close(running[index], now, variant, prior)
                if j + 1 in blocks:
                    found[index].append(running[index].statistic)
            if j + 1 < max(blocks):
                now = after if j == 0 else rows_of(j + 1)
    return found


def _start(rows: LiftedRows, variant: RecursionVariant, prior: PriorOf) -> Running:
    """Return the state before the first block, which takes its weights from the second one."""
    drives = rows.target.shape[0]
    return Running(
        empty_statistic(drives),
        open_velocity(drives),
        sources_of(masked(rows, variant.mask)),
        prior.mean.repeat(drives, 1),
    )


def _close(state: Running, rows: LiftedRows, variant: RecursionVariant, prior: PriorOf) -> Running:
    rows = masked(rows, variant.mask)
    psi = lift(state.k).psi
    weights = weights_of(state.sources, psi, state.velocity, rows.present)
    block = block_score(rows, weights, state.velocity, psi, variant.told)
    statistic = added(state.statistic, block)
    velocity = velocity_after(rows, weights, state.velocity)
    k = refine(statistic, state.k, prior, "combined", RUNNING_STEPS).k
    whole = (rows.present >= variant.mask).all(1)
    sources = Sources(
        *(
            torch.where(whole.view(-1, *[1] * (new.dim() - 1)), new, old)
            for new, old in zip(sources_of(rows), state.sources, strict=True)
        )
    )
    return Running(statistic, velocity, sources, torch.where(k.isfinite(), k, state.k))
