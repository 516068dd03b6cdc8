# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Does the model with the effect predict runs that it has not seen better than the model without?

The rule: the effect is added where the 95 % interval of the improvement on the held-out runs lies above zero. The measure is the root
mean square error of all rows, each second predicted from the one before, in standard deviations of what the model expects; 1 is the
noise floor, what it would be if the model were true.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch

from terrain_estimator.discovery.held_out import Half, Model, equations_of, halves
from terrain_estimator.discovery.library import NOTHING
from terrain_estimator.discovery.one_step import names, one_step
from terrain_estimator.discovery.physics import Nominal
from terrain_estimator.discovery.resampling import Floats, Rows, interval, replicates, resampled
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.discovery.scores import Predicted, Score, joined, regions_of, scores
from terrain_estimator.discovery.search import Candidate

NEIGHBOURS = 5
"""[blocks] that are resampled together: five seconds, longer than what ties the errors of neighbouring seconds."""
FLOOR = 1.0
"""[standard deviations] Root mean square error of a model that is true."""


@dataclass(frozen=True, slots=True)
class Gap:
    """The error on held-out runs in units of what the model expects, and how much of its way to the noise floor is gone."""

    before: float
    after: float | None
    noise_floor: float
    closed: float | None  # [1] (before - after) / (before - noise_floor); None where there was no gap
    closed_95: tuple[float, float] | None  # None where chance alone may have made the gap
    improvement_95: tuple[float, float] | None  # of before - after
    replicates: int  # pieces of NEIGHBOURS seconds on which the intervals rest


@dataclass(frozen=True, slots=True)
class Strength:
    """c and tan phi of a half of a held-out run, before and after, with their standard deviations."""

    run: str
    half: int
    cohesion_pa: tuple[float, float | None]
    cohesion_pa_sd: tuple[float, float | None]
    tan_phi: tuple[float, float | None]
    tan_phi_sd: tuple[float, float | None]


@dataclass(frozen=True, slots=True)
class Rollout:
    """The five seconds in which the model without the effect was most wrong, for a picture: simulated from the wheel rates alone."""

    run: str
    signal: str
    unit: str
    time_s: tuple[float, ...]
    measured: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class Proof:
    """What the held-out runs say of a model without (before) and with (after) an effect."""

    effect: str  # label of the hypothesis, empty where nothing is to be added
    added: bool
    gap: Gap
    rows: tuple[Score, ...]
    parameters: tuple[Strength, ...]
    rollout: Rollout | None

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        gap = self.gap
        if not self.effect or gap.after is None or gap.improvement_95 is None:
            return f"nothing was added; the error on held-out runs is {gap.before:.2f} of what the model expects"
        low, high = gap.improvement_95
        changed = f"the error on held-out runs went from {gap.before:.2f} to {gap.after:.2f} of what the model expects"
        rule = f"95 % interval of the improvement {low:.2f} to {high:.2f}"
        if not self.added:
            return f"{self.effect} did not prove itself and is not added: {changed}, {rule}"
        return f"{self.effect} is added: {changed}, {rule}"


Spread = Callable[[Callable[[Blocks], tuple[Half, Half]], Sequence[Blocks]], Iterable[tuple[Half, Half]]]
"""Applies a function to every run, in order: the built-in map, or a cluster."""


def prove(nominal: Nominal, candidate: Candidate | None, runs: Sequence[Blocks], seed: int = 0, spread: Spread = map) -> Proof:
    """Confront ``candidate``, which was fitted to other runs, with the held-out ``runs``; None where nothing is to be added.

    Raises:
        RunError: a run is too short.
    """
    models: tuple[Model, ...] = (Model(NOTHING, torch.zeros(0, dtype=torch.float64), torch.zeros(0, 0, dtype=torch.float64)),)
    if candidate is not None:
        models += (Model(candidate.hypothesis, candidate.fit.point.shared, candidate.fit.covariance),)
    judged = [half for pair in spread(partial(halves, nominal, models), runs) for half in pair]
    before, *rest = (_one_step(nominal, judged, number, model) for number, model in enumerate(models))
    after = rest[0] if rest else None
    gap = _gap(before, after, [len(half.blocks.packed) for half in judged], np.random.default_rng(seed))
    by_run = regions_of(runs)
    regions = {name: torch.cat([each[name] for each in by_run]) for name in by_run[0]}
    rows = scores("one_step", names(nominal.rover.axles), regions, before, after)
    added = gap.improvement_95 is not None and gap.improvement_95[0] > 0.0
    label = "" if candidate is None else candidate.hypothesis.label
    return Proof(label, added, gap, tuple(rows), tuple(_strength(half, number % 2) for number, half in enumerate(judged)), None)


def _one_step(nominal: Nominal, judged: Sequence[Half], number: int, model: Model) -> Predicted:
    parts = [one_step(equations_of(nominal, half, number, model), half.grounds[number], half.blocks.follows()) for half in judged]
    return joined(parts)


def _gap(before: Predicted, after: Predicted | None, lengths: Sequence[int], generator: np.random.Generator) -> Gap:
    pieces = replicates(lengths, NEIGHBOURS)
    first = _error(before)
    every = np.arange(len(before.count))[None]
    start = float(first(every)[0])
    if after is None:
        return Gap(start, None, FLOOR, None, None, None, pieces)
    second = _error(after)
    end = float(second(every)[0])
    drawn = resampled(lengths, NEIGHBOURS, generator)
    improvement = interval(lambda rows: first(rows) - second(rows), drawn)
    if start <= FLOOR:
        return Gap(start, end, FLOOR, None, None, improvement, pieces)

    def closed(rows: Rows) -> Floats:
        there = first(rows)
        return np.where(there > FLOOR, (there - second(rows)) / np.maximum(there - FLOOR, 1e-9), np.nan)

    ends = interval(closed, drawn)
    return Gap(start, end, FLOOR, (start - end) / (start - FLOOR), ends if np.isfinite(ends).all() else None, improvement, pieces)


def _error(predicted: Predicted) -> Callable[[Rows], Floats]:
    """Root mean square error of the rows of chosen blocks, in standard deviations."""
    misfit, count = predicted.misfit.numpy(), predicted.count.numpy()
    return lambda rows: np.sqrt(misfit[rows].sum(1) / count[rows].sum(1))


def _strength(half: Half, number: int) -> Strength:
    grounds = half.grounds
    means = [ground.unknowns.theta.tolist() for ground in grounds]
    spreads = [ground.covariance.diagonal()[:2].sqrt().tolist() for ground in grounds]

    def pair(table: list[list[float]], index: int, unit: float) -> tuple[float, float | None]:
        return unit * table[0][index], unit * table[1][index] if len(table) > 1 else None

    columns = [pair(table, index, unit) for index, unit in ((0, 1000.0), (1, 1.0)) for table in (means, spreads)]
    return Strength(half.blocks.name, number, *columns)
