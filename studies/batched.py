# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model's recursion over many drives at once, block by block, under ``torch.vmap``.

The steps of a block are the model's own; what differs is the driver with the branches. The
streaming model drops inactive hypotheses; here every drive keeps as many as the model ever holds,
inactive ones last, with a log weight of -inf. Where drives differ in what has to be solved, as many
are solved as the drive with the most of them needs.

Drives differ in where their blocks end, because an observation without a usable wheel breaks the
chain of velocities and closes its block early. So the blocks are laid out first, and the j-th
blocks of all drives that have the same length are run as one batch.
"""

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import torch
from torch import Tensor

from terrain_estimator.model.agreement import LARGEST_ERROR
from terrain_estimator.model.bank import Bank, Solved, join, members_of, restarted
from terrain_estimator.model.block import (
    MOST_STEPS,
    BlockRows,
    GaussNewtonStep,
    Posterior,
    Solution,
    extended,
    gauss_newton,
    has_converged,
    solution_of,
)
from terrain_estimator.model.packing import view_of, with_slip, without_link
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics import SoilRows
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.state import State

_FieldsT = TypeVar("_FieldsT", Posterior, BlockRows)


class ClosedBlocks(NamedTuple):
    """The j-th blocks of G drives on the model's only soil, as they were closed."""

    drives: Tensor  # [G] their indices
    block: int  # j
    before: State
    rows: BlockRows
    after: State


Watch = Callable[[ClosedBlocks], None]
"""What is called with every batch of closed blocks."""
CHUNK = 16
"""Blocks whose rows are computed at once, so that they stay in the processor's cache."""


class Trace(NamedTuple):
    """The results of N drives of T observations, with B blocks at most and K chosen times."""

    mean: Tensor  # [N, K, 2] of (c [Pa], tan phi)
    covariance: Tensor  # [N, K, 2, 2]
    misfit: Tensor  # [N, B] squared Mahalanobis distance of a block, NaN where there is none
    degrees: Tensor  # [N, B] its degrees of freedom
    innovation: Tensor  # [N, T] measured minus predicted velocity [m/s], NaN where not linked
    variance: Tensor  # [N, T] of the innovation [m^2/s^2]
    final: Tensor  # [N, D] last mean of all parameters


@dataclass(frozen=True, slots=True)
class Layout:
    """The blocks of each drive [N, B]: first observation, length (0: no block), closing one."""

    first: Tensor
    length: Tensor
    closed_at: Tensor  # T where nothing closes it
    linked: Tensor  # [N, T] bool: the velocity carries over from the observation before


def lay_out(model: PAlpaca, packed: Tensor, ends: Tensor) -> Layout:
    """Return the blocks of packed drives [N, T, P], of which the first ``ends`` [N] count."""
    drives, time, _ = packed.shape
    view = view_of(packed, model.axles)
    usable = _in_every_range(model, packed) & torch.isfinite(view.contact_angle)
    linked = usable.all(2) & (view.linked > 0.0)
    linked[:, 0] = False
    count = torch.zeros(drives, dtype=torch.long)
    block = torch.full((drives,), -1)
    first, length, closed_at = (torch.full((drives, time), fill) for fill in (0, 0, time))
    every = torch.arange(drives)
    for t in range(time):
        running = t < ends
        opens = running & (~linked[:, t] | (count == model.block_size))
        broken = every[opens & (count > 0) & (count < model.block_size)]
        closed_at[broken, block[broken]] = t
        block = block + opens.long()
        count = torch.where(opens, 1, count + 1)
        here = every[running]
        first[every[opens], block[opens]] = t
        length[here, block[here]] = count[here]
        full = every[running & (count == model.block_size)]
        closed_at[full, block[full]] = t
    most = int(block.max()) + 1
    return Layout(first[:, :most], length[:, :most], closed_at[:, :most], linked)


def run(
    model: PAlpaca,
    packed: Tensor,
    times: Tensor,
    ends: Tensor | None = None,
    rows: Tensor | None = None,
    watch: Watch | None = None,
) -> Trace:
    """Run ``model`` over packed drives [N, T, P] from its own prior.

    The estimates are those published after the observations ``times`` [K] (counted from 0). A drive
    ends with its first ``ends`` [N] observations and keeps its last estimate. ``rows`` [R] is 1 for
    the rows that may be used, 0 for others. ``watch`` sees the blocks of a model of one soil.
    """
    drives, time, _ = packed.shape
    layout = lay_out(model, packed, torch.full((drives,), time) if ends is None else ends)
    packed = _without_unusable(model, packed)
    packed = torch.where(layout.linked.unsqueeze(-1), packed, without_link(packed))
    mask = torch.ones(len(row_names(model.axles)), dtype=torch.float64) if rows is None else rows
    with torch.inference_mode():
        state = {
            name: value.expand(drives, *value.shape).clone()
            for name, value in model.initial().items()
            if name != "block"
        }
        trace = _empty(state, drives, time, layout.first.shape[1], times.shape[0], model)
        for j in range(layout.first.shape[1]):
            for chosen, place, closes in _groups(layout, j):
                _run_block(
                    model,
                    state,
                    packed[chosen.unsqueeze(1), place],
                    mask,
                    _Target(trace, chosen, place, j, closes, watch),
                )
            _publish(model, state, trace, layout, times, j)
    return trace


def _in_every_range(model: PAlpaca, packed: Tensor) -> Tensor:
    """Return which wheels [N, T, W] of packed drives are in the range of every soil."""
    view = view_of(packed, model.axles)
    slip, sinkage = (field.reshape(-1, model.axles) for field in (view.slip, view.sinkage))
    return nominal_of(model.physics).in_every_range(slip, sinkage).view(view.slip.shape)


def _without_unusable(model: PAlpaca, packed: Tensor) -> Tensor:
    """Return packed drives with slips outside any soil's range as NaN.

    Every soil has to explain the same rows.
    """
    slip = view_of(packed, model.axles).slip
    return with_slip(packed, torch.where(_in_every_range(model, packed), slip, torch.nan))


class _Target(NamedTuple):
    """The place of the results of one batch of blocks."""

    trace: Trace
    chosen: Tensor  # [G] drives
    place: Tensor  # [G, n] observations
    block: int
    closes: bool  # else the drive ends within this block
    watch: Watch | None


def _empty(state: State, drives: int, time: int, blocks: int, times: int, model: PAlpaca) -> Trace:
    nan = float("nan")
    estimate = torch.vmap(model.estimate)(state)
    return Trace(
        mean=estimate[:, :1].repeat(1, times, 1),
        covariance=estimate[:, 1:].unsqueeze(1).repeat(1, times, 1, 1),
        misfit=torch.full((drives, blocks), nan, dtype=torch.float64),
        degrees=torch.full((drives, blocks), nan, dtype=torch.float64),
        innovation=torch.full((drives, time), nan, dtype=torch.float64),
        variance=torch.full((drives, time), nan, dtype=torch.float64),
        final=state["expected"],  # written in place with the state
    )


def _groups(layout: Layout, j: int) -> Iterator[tuple[Tensor, Tensor, bool]]:
    """Yield the drives [G] whose j-th blocks are alike in length, first link and end.

    With them come their observations [G, n], and whether they close.
    """
    first, length = layout.first[:, j], layout.length[:, j]
    starts_linked = layout.linked.gather(1, first.unsqueeze(1)).squeeze(1)
    closes = layout.closed_at[:, j] < layout.linked.shape[1]
    kind = 4 * length + 2 * starts_linked.long() + closes.long()
    for value in torch.unique(kind[length > 0]).tolist():
        chosen = torch.nonzero(kind == value).squeeze(1)
        yield chosen, first[chosen].unsqueeze(1) + torch.arange(value // 4), value % 2 == 1


def _run_block(model: PAlpaca, state: State, packed: Tensor, mask: Tensor, target: _Target) -> None:
    """Take the observations [G, n, P] of a block, close it, and write the results in place."""
    chosen, trace = target.chosen, target.trace
    part = {name: value[chosen] for name, value in state.items()}
    active = int((part["log_weight"] != -torch.inf).sum(1).max())
    part |= {name: part[name][:, :active] for name in _OF_HYPOTHESES}
    for i in range(packed.shape[1]):
        view = view_of(packed[:, i], model.axles)
        if i == 0 and not bool(view.linked[0] > 0.0):
            part = torch.vmap(model.velocity.unlink)(part, view.velocity, view.velocity_sd**2)
            continue
        part = torch.vmap(model.track)(part, view)
        trace.innovation[chosen, target.place[:, i]] = part["innovation"]
        trace.variance[chosen, target.place[:, i]] = part["innovation_variance"]
    if not target.closes:
        return
    before, (part, rows) = part, _closed(model, part, packed, mask)
    if target.watch is not None:
        every = torch.arange(chosen.shape[0])
        target.watch(ClosedBlocks(chosen, target.block, before, rows[0].of(every), part))
    trace.misfit[chosen, target.block] = part["misfit"]
    trace.degrees[chosen, target.block] = part["degrees"]
    for name, value in part.items():
        if name in _OF_HYPOTHESES:
            state[name][chosen, : value.shape[1]] = value
        else:
            state[name][chosen] = value
    state["log_weight"][chosen, part["log_weight"].shape[1] :] = -torch.inf
    state["weight"][chosen, part["weight"].shape[1] :] = 0.0


_OF_HYPOTHESES = ("mean", "precision", "log_weight", "weight", "age", "kind")
"""Parts of the state with a place for each hypothesis; inactive ones stand last."""


def _publish(
    model: PAlpaca, state: State, trace: Trace, layout: Layout, times: Tensor, j: int
) -> None:
    """Write the estimates after the j-th blocks wherever these were closed by the chosen times."""
    late = (layout.length[:, j] > 0).unsqueeze(1) & (layout.closed_at[:, j].unsqueeze(1) <= times)
    estimate = torch.vmap(model.estimate)(state)
    trace.mean.copy_(torch.where(late.unsqueeze(-1), estimate[:, :1], trace.mean))
    trace.covariance.copy_(
        torch.where(
            late.unsqueeze(-1).unsqueeze(-1), estimate[:, 1:].unsqueeze(1), trace.covariance
        )
    )


def close(model: PAlpaca, state: State, packed: Tensor, mask: Tensor) -> State:
    """Return the states of G drives after blocks [G, n, P], by the steps of ``PAlpaca.close``."""
    return _closed(model, state, packed, mask)[0]


def _closed(
    model: PAlpaca, state: State, packed: Tensor, mask: Tensor
) -> tuple[State, list["_BlocksOnSoil"]]:
    """Return what :func:`close` does, and the blocks' rows on every soil."""
    seconds = view_of(packed, model.axles).step.sum(1)
    state = torch.vmap(model.hypotheses.diffuse)(state, seconds)
    rows = [
        _BlocksOnSoil(model, soil, packed, mask, state["expansion"][:, soil])
        for soil in range(model.known_soils)
    ]
    solved, degrees = _solve_active(model, state, rows)
    solved = _solve_restarted(model, state, rows, solved, degrees)
    bank, misfit = torch.vmap(model.hypotheses.select)(solved)
    state = torch.vmap(model.publish)(state, _inactive_last(bank))
    leading = torch.vmap(model.hypotheses.most_probable)(state["soils"])
    noise = [(leading == soil).view(-1, 1, 1, 1) * each.noise for soil, each in enumerate(rows)]
    finish = torch.vmap(model.finish)
    return finish(state, functools.reduce(torch.add, noise), misfit, degrees), rows


def _solve_active(
    model: PAlpaca, state: State, rows: list["_BlocksOnSoil"]
) -> tuple[Solved, Tensor]:
    """Return the hypotheses of G drives after their blocks, and the degrees of freedom [G]."""
    drives, pieces = state["log_weight"].shape[0], []
    soils = torch.vmap(model.hypotheses.active_soils)(state)
    degrees = torch.zeros(drives, dtype=torch.float64)
    for soil, each in enumerate(rows):
        members = soils == soil
        chosen = torch.nonzero(members.any(1)).squeeze(1)
        if chosen.numel() > 0:
            now = each.evaluated(chosen)
            solved = _solve_members(model, state, members, chosen, now.rows)
            for _ in range(model.most_reevaluations):
                again = each.anew(chosen, now, solved.solution.posterior)
                if again is None:
                    break
                now = again
                solved = _solve_members(model, state, members, chosen, now.rows)
            degrees[chosen] = each.of(chosen).present.sum(-1) - 1.0
            pieces.append(_scatter(solved, chosen, drives))
    return functools.reduce(torch.vmap(join), pieces), degrees


def _solve_restarted(
    model: PAlpaca, state: State, rows: list["_BlocksOnSoil"], solved: Solved, degrees: Tensor
) -> Solved:
    """Return ``solved`` with hypotheses started anew, for the drives whose block surprises."""
    surprised = torch.vmap(model.hypotheses.surprised)(solved.solution, degrees)
    chosen = torch.nonzero(surprised).squeeze(1)
    if chosen.numel() == 0:
        return solved
    part = {name: value[chosen] for name, value in state.items()}
    for soil, each in enumerate(rows):
        start = torch.vmap(functools.partial(model.hypotheses.restart, soil=soil))(part)
        solution = solve_blocks(start, each.of(chosen), model.longest_step)
        new = _scatter(restarted(solution, soil), chosen, degrees.shape[0])
        solved = torch.vmap(join)(solved, new)
    return solved


def _inactive_last(bank: Bank) -> Bank:
    """Return the banks of G drives, inactive hypotheses last, as long as the fullest drive's."""
    inactive = bank.weight == -torch.inf
    most = int((~inactive).sum(1).max())
    order = torch.argsort(inactive.long(), dim=1, stable=True)[:, :most]
    every = torch.arange(order.shape[0]).unsqueeze(1)
    return Bank(*(field[every, order] for field in bank))


class _Evaluated(NamedTuple):
    """Rows of the blocks of G drives, and where they were evaluated [G, 2 + M + V]."""

    rows: BlockRows
    at: Tensor


class _BlocksOnSoil:
    """Rows of the blocks of G drives on one soil, averaged at their first use."""

    def __init__(
        self, model: PAlpaca, soil: int, packed: Tensor, mask: Tensor, expansion: Tensor
    ) -> None:
        self._model, self._soil, self._packed, self._mask, self._expansion = (
            model,
            soil,
            packed,
            mask,
            expansion,
        )
        self._known = torch.zeros(packed.shape[0], dtype=torch.bool)
        view = view_of(packed, model.axles)
        slowest = view.slip.nan_to_num() - LARGEST_ERROR * view.slip_sd.nan_to_num()
        self._slowest = slowest.amin((1, 2))  # braked wheels cost a chunk more: they go together
        self._rows: BlockRows | None = None
        self.noise = packed.new_zeros(
            1, 1, 1, 1
        )  # [G, n, E, 3] of the velocity rows, zero where not needed

    def of(self, chosen: Tensor) -> BlockRows:
        """Return the rows of the ``chosen`` drives."""
        missing = chosen[~self._known[chosen]]
        if missing.numel() > 0:
            missing = missing[torch.argsort(self._slowest[missing])]
            averaged, noise = self._average(missing, self._expansion[missing])
            if self._rows is None:
                self._rows = BlockRows(
                    *(field.new_zeros(self._known.shape[0], *field.shape[1:]) for field in averaged)
                )
                self.noise = noise.new_zeros(self._known.shape[0], *noise.shape[1:])
            for whole, field in zip((*self._rows, self.noise), (*averaged, noise), strict=True):
                whole[missing] = field
            self._known[missing] = True
        assert self._rows is not None
        return BlockRows(*(field[chosen] for field in self._rows))

    def evaluated(self, chosen: Tensor) -> _Evaluated:
        """Return the rows of the ``chosen`` drives, and where they were evaluated."""
        return _Evaluated(self.of(chosen), self._expansion[chosen])

    def anew(self, chosen: Tensor, now: _Evaluated, after: Posterior) -> _Evaluated | None:
        """Return ``now`` with the rows of those of the ``chosen`` drives that moved evaluated anew.

        ``after`` is what these drives know after the block. None where none has moved.
        """
        places = torch.vmap(self._model.expansion_after)(after)
        moved = torch.vmap(self._model.physics.has_moved)(self._packed[chosen], now.at, places)
        if not bool(moved.any()):
            return None
        averaged, _ = self._average(chosen[moved], places[moved])
        every = (torch.nonzero(moved).squeeze(1),)
        rows = (old.index_put(every, new) for old, new in zip(now.rows, averaged, strict=True))
        return _Evaluated(BlockRows(*rows), now.at.index_put(every, places[moved]))

    def _average(self, chosen: Tensor, expansion: Tensor) -> SoilRows:
        packed = self._packed[chosen]
        average = functools.partial(self._model.average, soil=self._soil, chosen=self._mask)
        averaged: SoilRows = torch.vmap(
            lambda block, at: average(block, expansion=at), chunk_size=CHUNK
        )(packed, expansion)
        return averaged


def _solve_members(
    model: PAlpaca, state: State, members: Tensor, chosen: Tensor, rows: BlockRows
) -> Solved:
    """Return the solved hypotheses ``members`` [G, H] of the ``chosen`` drives.

    A drive that has fewer has its first one again, inactive.
    """
    here = members[chosen]
    place = torch.argsort((~here).long(), dim=1, stable=True)[:, : int(here.sum(1).max())]
    active = here.gather(1, place)
    place = torch.where(active, place, place[:, :1])
    (mean, precision, log_weight), age, kind = members_of(
        {name: state[name][chosen.unsqueeze(1), place] for name in _OF_HYPOTHESES}
    )
    solution = solve_blocks(
        Posterior(mean, precision, torch.where(active, log_weight, -torch.inf)),
        rows,
        model.longest_step,
    )
    return Solved(solution, age, kind)


def _scatter(solved: Solved, chosen: Tensor, drives: int) -> Solved:
    """Return hypotheses of the ``chosen`` of G drives, with inactive ones for the others."""
    posterior, misfit = solved.solution
    shape = (drives, misfit.shape[1])

    def spread(values: Tensor, fill: float = 0.0) -> Tensor:
        whole = values.new_full((*shape, *values.shape[2:]), fill)
        whole[chosen] = values
        return whole

    precision = torch.eye(posterior.mean.shape[-1], dtype=torch.float64).repeat(*shape, 1, 1)
    precision[chosen] = posterior.precision
    whole = Posterior(spread(posterior.mean), precision, spread(posterior.log_weight, -torch.inf))
    return Solved(Solution(whole, spread(misfit)), spread(solved.age), spread(solved.kind))


def solve_blocks(prior: Posterior, rows: BlockRows, longest_step: Tensor) -> Solution:
    """Return what ``solve_block`` does for G drives, with a leading dimension in every field.

    A drive that has converged is left alone.
    """
    newton = torch.vmap(gauss_newton, in_dims=(0, 0, 0, None))
    start = extended(prior)
    step = newton(start, start.mean, rows, longest_step)
    for _ in range(MOST_STEPS - 1):
        moving = torch.nonzero(~has_converged(step)).squeeze(1)
        if moving.numel() == 0:
            break
        chosen, own = _of_drives(start, moving), _of_drives(rows, moving)
        further = newton(chosen, step.mean[moving], own, longest_step)
        step = GaussNewtonStep(
            *(old.index_copy(0, moving, new) for old, new in zip(step, further, strict=True))
        )
    return torch.vmap(solution_of)(prior, step, rows)


def _of_drives(fields: _FieldsT, chosen: Tensor) -> _FieldsT:
    """Return the fields of the ``chosen`` drives."""
    return type(fields)(*(field[chosen] for field in fields))
