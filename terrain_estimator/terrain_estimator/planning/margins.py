# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Margins for a planner from samples of the ground.

These are pull against need, steepest slope, tightest turn, and the slip and sinkage to expect.
"""

import math
from dataclasses import dataclass

import numpy as np

from terrain_estimator.observation import Floats
from terrain_estimator.planning.belief import Samples, quantiles
from terrain_estimator.planning.statics import NOT_HELD, TURNS
from terrain_estimator.planning.table import TractionTable, highest_ratio, slip_for, steepest

LOWER, UPPER = 0.05, 0.95
"""Bounds, each at one-sided 95 %."""


@dataclass(frozen=True, slots=True)
class CredibleRange:
    """Median of a quantity, and its bounds of 95 % confidence each."""

    median: float
    lower: float
    upper: float


NOTHING = CredibleRange(math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class Margins:
    """Margins on one slope and in one turn, with all wheels on one ground."""

    available: CredibleRange  # [N] drawbar pull at a slip up to the limit
    needed: float  # [N] to hold the slope at constant speed
    stall_probability: float  # [1] that less is available than needed
    slope_limit: CredibleRange  # [rad] steepest slope
    slip: CredibleRange  # [1] 1 where the rover would be stuck; in a turn that of the outer wheels
    sinkage: CredibleRange  # [m]


def unknown_margins(needed: float) -> Margins:
    """Return margins in which only the needed pull is known."""
    return Margins(NOTHING, needed, math.nan, NOTHING, NOTHING, NOTHING)


def margins(
    table: TractionTable,
    samples: Samples,
    slope: float,
    slip_limit: float,
    pull_deviation: float,
    turn: float = 0.0,
) -> Margins:
    """Return the margins on ``slope`` [rad], positive uphill, in a ``turn`` as in TURNS [1].

    ``pull_deviation`` [weights] is the error of the model itself.
    """
    weight_across, need = table.rover.weight * math.cos(slope), math.tan(slope)
    columns: list[Floats] = []
    for soil, (strength, spare) in enumerate(zip(samples.strength, samples.spare, strict=True)):
        shift = pull_deviation * spare
        pulls = table.at(soil, strength, slope, turn)
        slip, sinkage = slip_for(pulls, need - shift)
        highest = highest_ratio(pulls, slip_limit) + shift
        limit = steepest(table, soil, strength, slip_limit, shift, turn)
        columns.append(np.stack([highest, limit, slip, sinkage]))
    ratio, limit, slip, sinkage = np.concatenate(columns, axis=1)
    weight = np.concatenate(samples.weight)
    return Margins(
        available=_held(_range(weight_across * ratio, weight), NOT_HELD * weight_across),
        needed=weight_across * need,
        stall_probability=float(weight[ratio < need].sum()),
        slope_limit=_held(_range(limit, weight), math.atan(NOT_HELD)),
        slip=_range(slip, weight),
        sinkage=_range(sinkage, weight),
    )


def _held(found: CredibleRange, least: float) -> CredibleRange:
    """Return the values, NaN where they come of turns that no rate of the inner wheels holds."""
    values = (found.median, found.lower, found.upper)
    return CredibleRange(*(value if value > least else math.nan for value in values))


def turn_limit(
    table: TractionTable, samples: Samples, slope: float, slip_limit: float, pull_deviation: float
) -> CredibleRange:
    """Return the share, as in TURNS [1], up to which every turn is held on ``slope`` [rad].

    Tighter turns may be held again. -1: not even straight on; NaN where turns are not known.
    """
    if not table.knows_turns:
        return NOTHING
    found = [
        _tightest(table, soil, strength, slope, slip_limit, pull_deviation * spare)
        for soil, (strength, spare) in enumerate(zip(samples.strength, samples.spare, strict=True))
    ]
    return _range(np.concatenate(found), np.concatenate(samples.weight))


def _tightest(
    table: TractionTable,
    soil: int,
    strength: Floats,
    slope: float,
    slip_limit: float,
    shift: Floats,
) -> Floats:
    need = math.tan(slope)
    spare = np.stack(
        [highest_ratio(table.at(soil, strength, slope, turn), slip_limit) for turn in TURNS], axis=1
    )
    spare += shift[:, None] - need
    held = np.logical_and.accumulate(spare >= 0.0, axis=1).sum(axis=1)
    row, last = np.arange(len(strength)), len(TURNS) - 1
    left, right = np.clip(held - 1, 0, last), np.clip(held, 0, last)
    fall = np.maximum(spare[row, left] - spare[row, right], 1e-12)
    share = np.clip(spare[row, left] / fall, 0.0, 1.0)
    turns = np.array(TURNS)
    between = turns[left] + share * (turns[right] - turns[left])
    return np.where(held == 0, -1.0, np.where(held > last, 1.0, between))


def stall_probability(
    table: TractionTable, samples: Samples, slope: float, slip_limit: float, pull_deviation: float
) -> float:
    """Return the stall probability of :func:`margins` alone, at a quarter of the cost."""
    probability = 0.0
    for soil, (strength, weight, spare) in enumerate(
        zip(samples.strength, samples.weight, samples.spare, strict=True)
    ):
        highest = (
            highest_ratio(table.at(soil, strength, slope), slip_limit) + pull_deviation * spare
        )
        probability += float(weight[highest < math.tan(slope)].sum())
    return probability


def _range(values: Floats, weight: Floats) -> CredibleRange:
    median, lower, upper = quantiles(values, weight, (0.5, LOWER, UPPER))
    return CredibleRange(median, lower, upper)
