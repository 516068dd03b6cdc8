# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The share of the way from the nominal model's error to the noise floor that an effect closes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from terrain_estimator.discovery.proof.resampling import (
    Floats,
    Rows,
    interval,
    replicates,
    resampled,
)
from terrain_estimator.discovery.proof.scores import Predicted

NEIGHBOURS = 5
"""[s] that are resampled together: longer than what ties the errors of neighbouring seconds."""

FAR = 3.0
"""[1] Error of rollouts, in noise floors, that chance does not explain.

A floor counts sensors, start, ground, sizes and terrain as unknown. Were all of that a single
Gaussian draw, the widest that the mean square can be, 0.27 % of true models would miss by more.
"""


@dataclass(frozen=True, slots=True)
class Gap:
    """Root mean square errors on held-out runs, in standard deviations of a noise.

    ``after`` is None where nothing is to be added.
    """

    before: float
    after: float | None
    # expected error if the better model were true: noise, and unknown ground and sizes
    noise_floor: float
    closed: (
        float | None
    )  # [1] (before - after) / (before - noise_floor); None where there was no gap
    closed_95: tuple[float, float] | None  # None where chance alone may have made the gap
    improvement_95: tuple[float, float] | None  # of before - after
    above_floor_95: tuple[float, float] | None  # of after - noise_floor
    nll_improvement_95: (
        tuple[float, float] | None
    )  # [nat] of the negative log likelihood of one value
    replicates: int  # pieces of NEIGHBOURS seconds on which the intervals rest

    @property
    def far_off(self) -> bool:
        """True where the model without an effect misses by more than FAR noise floors."""
        return self.before > FAR * self.noise_floor


def gap_of(before: Predicted, after: Predicted | None, lengths: Sequence[int], seed: int) -> Gap:
    """Return the gap over all seconds of pieces of these ``lengths``, with intervals.

    Intervals are by moving blocks.
    """
    pieces, every = replicates(lengths, NEIGHBOURS), np.arange(len(before.count))[None]
    first, floor = (
        _root_mean_square(before, before.misfit.numpy()),
        _root_mean_square(before, before.expected.numpy()),
    )
    if after is None:
        return Gap(
            float(first(every)[0]),
            None,
            float(floor(every)[0]),
            None,
            None,
            None,
            None,
            None,
            pieces,
        )
    second, floor = (
        _root_mean_square(after, after.misfit.numpy()),
        _root_mean_square(after, after.expected.numpy()),
    )
    start, end, least = (float(error(every)[0]) for error in (first, second, floor))

    def improvement(rows: Rows) -> Floats:
        return first(rows) - second(rows)

    def closed(rows: Rows) -> Floats:
        gap = first(rows) - floor(rows)
        return np.where(gap > 0.0, improvement(rows) / np.where(gap > 0.0, gap, 1.0), np.nan)

    def above_floor(rows: Rows) -> Floats:
        return second(rows) - floor(rows)

    gained, count = (before.surprise - after.surprise).numpy(), after.count.numpy()

    def likelier(rows: Rows) -> Floats:
        return gained[rows].sum(1) / count[rows].sum(1)

    drawn = resampled(lengths, NEIGHBOURS, np.random.default_rng(seed))
    ends = interval(closed, drawn)
    share = (start - end) / (start - least) if start > least else None
    return Gap(
        start,
        end,
        least,
        share,
        ends,
        interval(improvement, drawn),
        interval(above_floor, drawn),
        interval(likelier, drawn),
        pieces,
    )


def _root_mean_square(predicted: Predicted, total: Floats) -> Callable[[Rows], Floats]:
    """Return the root mean square over chosen seconds, from the sums of squares ``total`` [N]."""
    count = predicted.count.numpy()
    return lambda rows: np.sqrt(total[rows].sum(1) / count[rows].sum(1))
