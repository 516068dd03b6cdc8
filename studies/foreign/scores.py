# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of ``make foreign``, with 95 % limits.

Shares of drives have exact binomial limits. Figures of observations and blocks have limits by
resampling whole drives, since within a drive they depend on each other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.stats import binomtest, norm

from studies.foreign.drives import Driven, Floats
from studies.foreign.residuals import kinds, whitened
from studies.limited import Limited

FAR = 3.0
"""[deviations] An IDENTIFIED estimate further from the truth counts as wrong."""
RESAMPLES = 500
SHORTEST = 5
"""[blocks] A series of fewer has no autocorrelation."""


@dataclass(frozen=True, slots=True)
class ResidualScore:
    """Whitened residuals of one row kind: of mean 0, deviation 1 and correlation 0 if all holds."""

    name: str
    mean: Limited
    deviation: Limited
    correlation: Limited  # of neighbouring blocks


@dataclass(frozen=True, slots=True)
class DriveScore:
    """How one drive ended."""

    name: str
    identified: bool
    disagrees: bool
    mean: tuple[float, float]  # c [Pa], tan phi
    deviation: tuple[float, float]
    z: tuple[float, float]  # error over deviation
    inside: tuple[bool, bool]  # of the 95 % interval
    accepted: float  # share of observations that read as used
    taken: float  # share of the time of closed blocks that entered the posterior


@dataclass(frozen=True, slots=True)
class ModelScore:
    """All drives with one model."""

    model: str
    drives: tuple[DriveScore, ...]
    identified: Limited  # share of drives that end IDENTIFIED
    disagrees: Limited  # share of drives that end DISAGREES, with the prior published
    far: Limited  # IDENTIFIED and further than FAR in c or tan phi, of all drives
    outside: Limited  # IDENTIFIED and outside the 95 % interval in c or tan phi, of all drives
    far_at: Limited  # share of observations whose answer is IDENTIFIED and far
    ever_far: Limited  # share of drives with such an answer
    accepted: Limited  # share of observations
    taken: Limited  # share of the time of closed blocks
    predicted: Limited  # share of steps that had a forecast
    covered: Limited  # share of forecasts whose 95 % interval holds the measured velocity
    over_persistence: Limited  # rms error, true velocity, over that of "it stays as measured"
    error: float  # [m/s] the same rms error
    persistence: float  # [m/s]
    rows: tuple[ResidualScore, ...]  # of all closed blocks
    rows_taken: tuple[ResidualScore, ...]  # of those in the posterior


def score(model: str, names: Sequence[str], driven: Sequence[Driven]) -> ModelScore:
    """Return the figures of all drives with one model."""
    drives = tuple(_drive(name, each) for name, each in zip(names, driven, strict=True))
    known = [each.identified for each in drives]
    far = [each.identified and max(map(abs, each.z)) > FAR for each in drives]
    outside = [each.identified and not all(each.inside) for each in drives]
    lost = [(each.identified_at > 0.0) & (np.abs(each.z_at).max(1) > FAR) for each in driven]
    steps = [_steps(each) for each in driven]
    error, persistence = (np.sqrt(_ratio([s[[k, 2]] for s in steps])) for k in (0, 1))
    return ModelScore(
        model,
        drives,
        _share(known),
        _share([each.disagrees for each in drives]),
        _share(far),
        _share(outside),
        _resampled([np.array([each.sum(), each.size]) for each in lost], _ratio),
        _share([bool(each.any()) for each in lost]),
        _resampled(
            [np.array([each.accepted.sum(), each.accepted.size]) for each in driven], _ratio
        ),
        _resampled([_taken(each) for each in driven], _ratio),
        _resampled([s[[2, 4]] for s in steps], _ratio),
        _resampled([s[[3, 2]] for s in steps], _ratio),
        _resampled([s[:2] for s in steps], lambda parts: float(np.sqrt(_ratio(parts)))),
        float(error),
        float(persistence),
        _rows(driven, [np.ones_like(each.taken, dtype=bool) for each in driven]),
        _rows(driven, [each.taken > 0.0 for each in driven]),
    )


def _drive(name: str, driven: Driven) -> DriveScore:
    z = (driven.mean - driven.truth) / driven.deviation
    taken, whole = _taken(driven)
    first, second = (
        (float(driven.mean[k]), float(driven.deviation[k]), float(z[k]), bool(driven.inside_95[k]))
        for k in range(2)
    )
    pairs = list(zip(first, second, strict=True))
    return DriveScore(
        name,
        bool(driven.identified > 0.0),
        bool(driven.disagrees > 0.0),
        *pairs,  # type: ignore[arg-type, call-arg]
        float(driven.accepted.mean()),
        float(taken / whole),
    )


def _taken(driven: Driven) -> Floats:
    """Return the observations in blocks of the posterior, and in all closed blocks [2]."""
    return np.array([driven.length @ driven.taken, driven.length.sum()])


def _steps(driven: Driven) -> Floats:
    """Return sums over the steps that have a forecast, and the steps of the drive.

    Square error of the forecast, and of the velocity measured before, to the true one; number;
    number inside the 95 % interval; all steps. [5]
    """
    made = np.isfinite(driven.innovation)
    made[0] = False
    true, before = driven.true_velocity, np.roll(driven.velocity, 1)
    forecast = driven.velocity - driven.innovation
    inside = driven.innovation[made] ** 2 < norm.ppf(0.975) ** 2 * driven.variance[made]
    squares = (forecast - true)[made] ** 2, (before - true)[made] ** 2
    return np.array(
        [squares[0].sum(), squares[1].sum(), made.sum(), inside.sum(), made.size - 1], dtype=float
    )


def _ratio(parts: Sequence[Floats]) -> float:
    """Return the ratio of two sums over drives; each part is [2]."""
    above, below = np.sum(parts, axis=0)
    return float(above / below) if below > 0.0 else float("nan")


def _share(held: Sequence[bool]) -> Limited:
    found = binomtest(sum(held), len(held)).proportion_ci(0.95)
    return Limited(sum(held) / len(held), float(found.low), float(found.high))


def _resampled(parts: Sequence[Floats], figure: Callable[[Sequence[Floats]], float]) -> Limited:
    """Return a figure of all drives, with limits from drives drawn with replacement."""
    generator = np.random.default_rng(0)
    drawn = generator.integers(len(parts), size=(RESAMPLES, len(parts)))
    found = np.array([figure([parts[k] for k in chosen]) for chosen in drawn])
    known = found[np.isfinite(found)]
    low, high = np.quantile(known, (0.025, 0.975)).tolist() if known.size else (np.nan, np.nan)
    return Limited(figure(parts), low, high)


def _rows(driven: Sequence[Driven], chosen: Sequence[np.ndarray]) -> tuple[ResidualScore, ...]:
    """Return the residuals' figures by row kind; none where no block was chosen."""
    series = [
        whitened(torch.from_numpy(each.residual[here]), torch.from_numpy(each.noise[here])).numpy()
        for each, here in zip(driven, chosen, strict=True)
        if here.any()
    ]
    if not series:
        return ()
    return tuple(
        ResidualScore(
            name,
            *(_resampled([values[:, k] for values in series], figure) for figure in _FIGURES),
        )
        for k, name in enumerate(kinds(3))
    )


def _mean(series: Sequence[Floats]) -> float:
    return float(np.concatenate(series).mean())


def _deviation(series: Sequence[Floats]) -> float:
    return float(np.concatenate(series).std())


def _correlation(series: Sequence[Floats]) -> float:
    """Return the correlation of neighbouring blocks about zero, so that an offset counts."""
    long = [values for values in series if len(values) >= SHORTEST]
    if not long:
        return float("nan")
    products = np.concatenate([values[1:] * values[:-1] for values in long])
    return float(products.mean() / np.concatenate([values**2 for values in long]).mean())


_FIGURES = (_mean, _deviation, _correlation)
