# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Disagreement of every row in every region of every signal, in words and numbers.

Each region is a column of a row. Regressed on the innovations of the fit of "nothing missing"
(``whitening``) its coefficient is what the row disagrees by there beyond what the fit can absorb.
Its variance is that of independent innovations, of unit variance or of what the column leaves,
whichever is larger; and more where what it leaves is autocorrelated: the larger one of what a
first-order process and the sum of autocorrelations up to LAGS seconds with Bartlett's weights
(Newey and West 1987) make of it. The p value is Student's with the effective number of seconds as
degrees of freedom, adjusted after Holm 1979 for all rows, signals, regions and runs that were
tried, so that the chance of any false entry at all is at most the level.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.special import stdtr
from torch import Tensor

from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.locate.regions import Region, regions, wheels_name
from terrain_estimator.discovery.locate.whitening import innovations, whitening
from terrain_estimator.model.row_names import ROLL_MOMENT
from terrain_estimator.observation import Floats

LEVEL = 0.05
"""[1] Chance of any false entry."""
LAGS = 10
"""[s] Longest lag of which an autocorrelation is estimated."""
MOST = 10
"""Entries."""
LARGEST = 0.97
"""[1] Of an autocorrelation at one second."""


@dataclass(frozen=True, slots=True)
class RowDisagreement:
    """A row that does not agree with the model in a region of a signal."""

    row: str
    signal: str
    region: str
    strength: float  # measured less modelled, in ``unit``
    unit: str
    p: float  # adjusted for everything that was tried
    runs: tuple[str, ...]  # in which it shows by itself
    sentence: str


@dataclass(frozen=True, slots=True)
class Tests:
    """Regressions of columns on innovations: of every run, then of all together."""

    coefficient: Tensor  # [R + 1, K]
    statistic: (
        Tensor  # [R + 1, K] coefficient over its deviation; 0 where a run has nothing of the region
    )
    degrees: Tensor  # [R + 1, K] effective number of seconds
    blocks: Tensor  # [R + 1] seconds


def disagreements(study: Study) -> list[RowDisagreement]:
    """Return the disagreements, the surest first, each beside those before it."""
    equations = study.equations_of_nothing()
    points = study.nothing.fit.point.runs
    tried = regions(study.nominal, study.runs, points)
    left, columns = [], []
    for equation, unknowns, own in zip(equations, points, tried.columns, strict=True):
        white = whitening(equation, unknowns)
        left.append(innovations(white, equation, unknowns))
        columns.append(white.of(own))
    alike = torch.tensor([region.alike for region in tried.names], dtype=torch.float64)
    listed: list[RowDisagreement] = []
    while len(listed) < MOST:
        found = tests(left, columns)
        chance = two_sided(found, alike)
        adjusted = holm(chance)
        k = _surest(found, adjusted)
        if adjusted[:, k].min() > LEVEL:
            break
        listed.append(_described(study, tried.names[k], k, found, chance, adjusted))
        left, columns = _without(left, columns, k)
    return listed


def _surest(found: Tests, adjusted: Floats) -> int:
    return int(np.lexsort((-found.statistic.abs().amax(0).numpy(), adjusted.min(0)))[0])


def _without(
    left: Sequence[Tensor], columns: Sequence[Tensor], k: int
) -> tuple[list[Tensor], list[Tensor]]:
    """Return innovations and columns without column ``k``, in every run by itself."""
    rest, others = [], []
    for e, g in zip(left, columns, strict=True):
        one = g[..., k]
        power = one.square().sum().clamp(min=1e-12)
        rest.append(e - one * ((one * e).sum() / power))
        others.append(g - one.unsqueeze(-1) * ((one.unsqueeze(-1) * g).sum((0, 1)) / power))
    return rest, others


def tests(left: Sequence[Tensor], columns: Sequence[Tensor]) -> Tests:
    """Regress ``columns`` [B, Q, K] on the innovations ``left`` [B, Q] of every run and of all."""
    parts = [_sums(e, g) for e, g in zip(left, columns, strict=True)]
    single = [_one(part) for part in parts]
    joint = _one([sum(each) for each in zip(*parts, strict=True)])
    size, statistic, degrees = (
        torch.stack([each[i] for each in [*single, joint]]) for i in range(3)
    )
    seconds = torch.tensor([float(len(each)) for each in left], dtype=torch.float64)
    return Tests(size, statistic, degrees, torch.cat([seconds, seconds.sum().unsqueeze(0)]))


def _sums(left: Tensor, columns: Tensor) -> list[Tensor]:
    """Return products of columns and innovations at lags 0 to LAGS, and the number of seconds.

    Each is [LAGS + 1, Q, K].
    """
    blocks = left.shape[0]
    wide = left.unsqueeze(-1)
    gg, ge, ee = [], [], []
    for lag in range(LAGS + 1):
        early, late = slice(0, max(blocks - lag, 0)), slice(lag, blocks)
        gg.append((columns[early] * columns[late]).sum(0))
        ge.append((columns[early] * wide[late] + wide[early] * columns[late]).sum(0))
        ee.append((wide[early] * wide[late]).sum(0).expand_as(gg[-1]))
    return [
        torch.stack(gg),
        torch.stack(ge),
        torch.stack(ee),
        torch.tensor(float(blocks), dtype=torch.float64),
    ]


def _one(sums: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """Return coefficient, statistic and effective seconds [K] of every column."""
    gg, ge, ee, blocks = sums
    information = gg[0].sum(0)
    some = information > 1e-9
    safe = torch.where(some, information, 1.0)
    size = 0.5 * ge[0].sum(0) / safe
    lagged = ee - size * ge + size.square() * gg  # of what the column leaves, [LAGS + 1, Q, K]
    power = (lagged[:1] / blocks).clamp(min=1.0)
    correlation = lagged[1:] / lagged[:1].clamp(min=1e-12)
    lags = torch.arange(1, LAGS + 1, dtype=torch.float64).view(-1, 1, 1)
    first = correlation[:1].clamp(0.0, LARGEST) ** lags
    tapered = correlation * (1.0 - lags / (LAGS + 1.0))
    white = (power[0] * gg[0]).sum(0)
    surplus = (
        torch.stack([2.0 * (power * gg[1:] * each).sum((0, 1)) for each in (first, tapered)])
        .amax(0)
        .clamp(min=0.0)
    )
    variance = torch.where(some, white + surplus, 1.0)
    degrees = blocks * white / variance
    statistic = torch.where(some, size * safe / variance.sqrt(), 0.0)
    return torch.where(some, size, 0.0), statistic, degrees


def two_sided(found: Tests, alike: Tensor) -> Floats:
    """Return p values [R + 1, K] of single tests, before any adjustment.

    ``alike`` [K] bounds the correlation that noise which lasts makes between a row and a signal: it
    may move a statistic by ``alike`` times the root of the number of seconds, which counts for
    nothing.
    """
    beyond = (found.statistic.abs() - alike * found.blocks.sqrt().unsqueeze(1)).clamp(min=0.0)
    return np.asarray(2.0 * stdtr(found.degrees.clamp(min=1.0).numpy(), -beyond.numpy()))


def holm(chance: Floats) -> Floats:
    """Return p values adjusted for the number of tests, whatever their dependence (Holm 1979).

    The chance of any false rejection is at most the level.
    """
    flat = chance.ravel()
    order = np.argsort(flat, kind="stable")
    stepped = np.maximum.accumulate(flat[order] * np.arange(flat.size, 0, -1))
    adjusted = np.empty_like(flat)
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted.reshape(chance.shape)


def _described(
    study: Study, region: Region, k: int, found: Tests, chance: Floats, adjusted: Floats
) -> RowDisagreement:
    """Describe a region in words.

    It is a run's own where all runs together are less sure than that run.
    """
    which = int(adjusted[:, k].argmin())
    together = len(study.runs)
    size = float(found.coefficient[which, k])
    names = [run.name for run in study.runs]
    runs: tuple[str, ...] = tuple(names[which : which + 1])
    if which == together:
        alike = np.sign(found.coefficient[:together, k].numpy()) == np.sign(size)
        runs = tuple(
            name
            for name, p, same in zip(names, chance[:together, k], alike, strict=True)
            if same and p < LEVEL
        )
    factor, unit = unit_of(region.row, study.nominal)
    strength, p = factor * size, float(adjusted[which, k])
    return RowDisagreement(
        region.row,
        region.signal,
        region.words,
        strength,
        unit,
        p,
        runs,
        sentence(region, strength, unit, p, runs, names, study.nominal),
    )


def unit_of(row: str, nominal: Nominal) -> tuple[float, str]:
    """Return the factor and the unit of a row for a reader."""
    rover = nominal.rover
    weight = rover.mass * rover.gravity
    if row == "load":
        return weight, "N"
    if row in ("moment", "bogie_moment", ROLL_MOMENT, "yaw_rate"):
        return weight * abs(rover.axle_x[0] - rover.axle_x[-1]), "N m"
    return 1.0, "N m" if row.startswith("torque") else "m/s^2"


def sentence(
    region: Region,
    strength: float,
    unit: str,
    p: float,
    runs: Sequence[str],
    every: Sequence[str],
    nominal: Nominal,
) -> str:
    """Return a sentence on a disagreement.

    Such as ``velocity row, slope above 6 deg uphill: accelerates 0.12 m/s^2 less than modelled (p <
    1e-6, run_1, run_3)``.
    """
    place = (
        "everywhere" if region.signal in ("none", "wheel") else f"{region.signal} {region.words}"
    )
    more = "more" if strength > 0.0 else "less"
    words = f"{_MEASURED[region.row.split('_')[0]]} {abs(strength):.2g} {unit} {more} than modelled"
    certain = "p < 1e-6" if p < 1e-6 else f"p = {p:.1g}"
    shown = (
        "no run by itself"
        if not runs
        else "all runs"
        if len(runs) == len(every)
        else ", ".join(runs)
    )
    return f"{row_words(region.row, nominal)}, {place}: {words} ({certain}, {shown})"


def row_words(row: str, nominal: Nominal) -> str:
    """Return the name of a row for a reader."""
    return (
        f"torque row of the {wheels_name(int(row.removeprefix('torque_')), nominal)}"
        if row.startswith("torque")
        else f"{row.replace('_', ' ')} row"
    )


_MEASURED = {
    "velocity": "the rover accelerates along the slope",
    "load": "the weight to carry is",
    "torque": "the torque of a wheel is",
    "acceleration": "the accelerometer reads",
    "moment": "the wheels turn the rover by",
    "bogie": "the wheels turn the bogie by",
    "roll": "the wheels roll the rover by",
    "lateral": "the rover accelerates to the left",
    "yaw": "the rover's turn to the left quickens by",
}
