# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Batched root finding: a bracketed search for one unknown, a quasi-Newton method for several."""

from collections.abc import Callable

import torch
from torch import Tensor

TOLERANCE = 1e-10
"""[1] Largest residual of :func:`quasi_newton` that counts as solved."""
MAX_ITERATIONS = 24
REFRESH = 5
"""Iterations between two Jacobians by differences; Broyden's update serves in between."""
LARGEST_MOVE = 0.5
"""[1] Bound of a move: unknowns are logarithms, slips and velocities in units of the rover."""

Rows = Callable[[Tensor, Tensor], Tensor]
"""Function of unknowns [rows, m] and of the indices [rows] of their episodes."""


def bracketed_root(
    function: Callable[[Tensor], Tensor],
    low: Tensor,
    high: Tensor,
    tolerance: float,
    evaluations: int = 40,
) -> Tensor:
    """Return the root in [low, high] of a rising function of one unknown, elementwise.

    The method is regula falsi, Illinois variant.

    Where the function has no root inside, the end nearer to it. Stops when every bracket is
    narrower than ``tolerance``; every third trial is the middle, so that it always gets there.
    """
    below, above = function(low), function(high)
    best = torch.where(below >= 0.0, low, torch.where(above <= 0.0, high, (low + high) / 2.0))
    open_ = (below < 0.0) & (above > 0.0)
    side = torch.zeros_like(low)
    for evaluation in range(evaluations):
        if not bool(open_.any()):
            break
        chord = (low * above - high * below) / (above - below).clamp(min=1e-300)
        trial = torch.where(open_, (low + high) / 2.0 if evaluation % 3 == 2 else chord, best)
        value = function(trial)
        rises = value > 0.0
        # The end that stays put for a second time counts half, or it would stay for ever.
        below = torch.where(rises, torch.where(side > 0.0, below / 2.0, below), value)
        above = torch.where(rises, value, torch.where(side < 0.0, above / 2.0, above))
        low, high = torch.where(rises, low, trial), torch.where(rises, trial, high)
        side = torch.where(rises, 1.0, -1.0).to(low.dtype)
        best = trial
        open_ = open_ & (high - low > tolerance) & (value != 0.0)
    return best


def quasi_newton(
    residual: Rows, jacobian: Rows, start: Tensor, limits: tuple[Tensor, Tensor]
) -> tuple[Tensor, Tensor]:
    """Solve residual(u) = 0 for every episode from ``start`` [batch, m] inside ``limits``.

    ``limits`` is ([m], [m]).

    Newton with Broyden's update of the Jacobian in between; episodes drop out as they converge.
    Returns the unknowns [batch, m], the last iterate where there is no solution, and where they are
    solved [batch].
    """
    answer, solved = start.clamp(*limits), torch.zeros(start.shape[0], dtype=torch.bool)
    index, u = torch.arange(start.shape[0]), answer
    value, slope = residual(u, index), jacobian(u, index)
    for iteration in range(1, MAX_ITERATIONS + 1):
        done = value.abs().amax(-1) < TOLERANCE
        if bool(done.any()):
            answer[index[done]], solved[index[done]] = u[done], True
            index, u, value, slope = index[~done], u[~done], value[~done], slope[~done]
        if index.numel() == 0:
            return answer, solved
        moved = (u + _move(slope, value)).clamp(*limits)
        after = residual(moved, index)
        slope = (
            jacobian(moved, index)
            if iteration % REFRESH == 0
            else _broyden(slope, moved - u, after - value)
        )
        u, value = moved, after
    answer[index] = u
    return answer, solved


def _move(slope: Tensor, value: Tensor) -> Tensor:
    """Return Newton's move, bounded; zero where the Jacobian is singular."""
    move, broken = torch.linalg.solve_ex(slope, -value.unsqueeze(-1))
    move = move.squeeze(-1)
    return torch.where((broken != 0).unsqueeze(-1) | ~move.isfinite(), 0.0, move).clamp(
        -LARGEST_MOVE, LARGEST_MOVE
    )


def _broyden(slope: Tensor, move: Tensor, change: Tensor) -> Tensor:
    """Return the Jacobian nearest to ``slope`` that explains the change over the last move."""
    missed = change - torch.einsum("...ij,...j->...i", slope, move)
    along = move / (move**2).sum(-1, keepdim=True).clamp(min=1e-30)
    return slope + missed.unsqueeze(-1) * along.unsqueeze(-2)


HALVINGS = 8
"""Times that :func:`damped_newton` halves a move before it takes the shortest."""


def damped_newton(
    residual: Rows,
    jacobian: Rows,
    start: Tensor,
    limits: tuple[Tensor, Tensor],
    iterations: int = 15,
) -> tuple[Tensor, Tensor]:
    """Solve as :func:`quasi_newton` does, slowly and from further away.

    Each move is halved until it makes the residual smaller, so that a force that saturates, such as
    friction, does not throw the unknowns to and fro.
    """
    answer, solved = start.clamp(*limits), torch.zeros(start.shape[0], dtype=torch.bool)
    index, u = torch.arange(start.shape[0]), answer.clone()
    value = residual(u, index)
    for _ in range(iterations):
        done = value.abs().amax(-1) < TOLERANCE
        answer[index], solved[index[done]] = u, True
        index, u, value = index[~done], u[~done], value[~done]
        if index.numel() == 0:
            break
        move = _move(jacobian(u, index), value)
        size, share = value.norm(dim=-1), torch.ones_like(u[:, :1])
        moved, after = u, value
        for _ in range(HALVINGS):
            moved = (u + share * move).clamp(*limits)
            after = residual(moved, index)
            worse = ~(after.norm(dim=-1) < size)
            if not bool(worse.any()):
                break
            share = torch.where(worse.unsqueeze(-1), 0.5 * share, share)
        u, value = moved, after
    answer[index] = u
    return answer, solved
