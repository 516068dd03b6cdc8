# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures and the page of ``make recursion``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import norm

from studies.accuracy.scores import HALF_NORMAL_MEDIAN, share_of
from studies.limited import Limited
from studies.recursion.study import ROW_SETS, SHIPPED, Record, methods
from studies.tables import licence, table

PARAMETERS = ("c", "tan phi")


@dataclass(frozen=True, slots=True)
class Scored:
    """One parameter."""

    median_error: float  # relative
    of_bound: float  # median error over the Cramer-Rao bound, 1 for an efficient estimator
    inside_95: Limited
    inside_68: Limited
    mean_z: float  # error over published deviation
    mean_z_limit: float  # 95 % confidence limit of the mean, both sides
    alone: int  # drives whose 95 % interval covers, where that of what ships does not
    not_alone: int  # the other way round


@dataclass(frozen=True, slots=True)
class Line:
    """One method on one set of drives after one time."""

    rover: str
    after_s: float
    rows: str
    method: str
    drives: int
    clamped: float  # median share of the information that was negative
    cohesion: Scored
    tan_phi: Scored


def cells(rover: str, records: Sequence[Record], times_s: Sequence[float]) -> list[Line]:
    """Return the lines of all drives of some records, judged after each of their times."""
    whole = {name: np.concatenate([each[name] for each in records]) for name in records[0]}
    return [
        _line(whole, rover, (place, after), rows, method)
        for place, after in enumerate(times_s)
        for rows in ROW_SETS
        for method in methods()
    ]


def _line(whole: Record, rover: str, time: tuple[int, float], rows: str, method: str) -> Line:
    place, after_s = time
    least = whole[f"{rows}|bound|least"][:, place]
    z, error = _deviations(whole, place, f"{rows}|{method}")
    shipped, _ = _deviations(whole, place, f"{rows}|{SHIPPED}")
    scored = [
        _scored(z[:, k], error[:, k], whole["truth"][:, k], least[:, k], shipped[:, k])
        for k in range(len(PARAMETERS))
    ]
    clamped = float(np.median(whole[f"{rows}|{method}|clamped"][:, place]))
    return Line(rover, after_s, rows, method, len(z), clamped, *scored)


def _deviations(
    whole: Record, place: int, name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return errors over published deviations [N, 2], and errors."""
    error = whole[f"{name}|mean"][:, place] - whole["truth"]
    covariance = whole[f"{name}|covariance"][:, place]
    return error / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), error


def _scored(
    z: NDArray[np.float64],
    error: NDArray[np.float64],
    truth: NDArray[np.float64],
    least: NDArray[np.float64],
    shipped: NDArray[np.float64],
) -> Scored:
    inside, usual = (np.abs(each) < norm.ppf(0.975) for each in (z, shipped))
    return Scored(
        median_error=float(np.median(np.abs(error) / truth)),
        of_bound=float(np.median(np.abs(error) / least) / HALF_NORMAL_MEDIAN),
        inside_95=share_of(torch.from_numpy(inside)),
        inside_68=share_of(torch.from_numpy(np.abs(z) < norm.ppf(0.84))),
        mean_z=float(z.mean()),
        mean_z_limit=float(norm.ppf(0.975) * z.std(ddof=1) / math.sqrt(len(z))),
        alone=int((inside & ~usual).sum()),
        not_alone=int((usual & ~inside).sum()),
    )


INTRODUCTION = """# A recursion without relinearisation

{measured}

Do intervals hold longer where the sums that a drive leaves behind never need a new place of
linearisation? A trial beside the model's recursion; no node uses it.

- **Drives.** Loose sand, over hills (S1), seed {seed}. Each soil constant is wrong by up to 5 %,
  c and tan phi are drawn from the models' prior. Every method gets the same drives.
- **As it ships**: the model's recursion, the soil known, without a net, as in
  [accuracy.md](accuracy.md).
- **The others** accumulate corrected scores of the products of (c, tan phi, 1) with powers of the
  soil constants' deviations, expanded to second order about the nominal constants
  (`studies/recursion/statistic.py`). Weights follow from blocks before. Instruments are the
  **columns**, or **columns corrected** by the residual at the estimate before the block.
- **Read-outs.** "Sandwich" solves the scores of least squares and clamps their information.
  "Gaussian" and "grid" minimise the squared scores in the metric of their own variance, which moves
  with c and tan phi; the grid integrates instead of taking a Gaussian at the minimum. "Every score"
  uses 20 scores instead of the 9 of least squares.

"""
LEGEND = """
- **Error**: median, relative. **Of bound**: median error over the Cramer-Rao bound.
- **In 95 %, in 68 %**: drives whose interval covers, with 99 % limits.
- **Mean z**: error over published deviation, with 95 % limits.
- **Gained, lost**: drives whose 95 % interval covers, where that of what ships does not, and the
  other way round.
- **Clamped**: median share of the information that was negative and left out.
"""


WHY = """
## What follows

- **The sandwich** is the read-out that was planned. The scores have mean zero and the predicted
  variance at the truth (a test checks both), but their derivative has noise as large as itself in
  some directions. Solving by it gives errors with long tails, and clamping its negative part leaves
  intervals that are too narrow.
- **Minimising the squared scores** in the metric of their variance never divides by that
  derivative, and needs no clamp. Where it is noise, the variance grows with it, and the prior
  stays.
- **Instruments corrected by the residual** keep the efficiency of orthogonal distance regression.
  Their correction is linear in the lifted parameters, too, for any place at which the residual was
  taken.
- **Cost.** The statistic has a constant size, 20 x 62 numbers for the scores and 7 x 20 x 20 for
  their variance, and no block is ever looked at again. As the constants' places are fixed, the
  forces are read from tables over slip and sinkage.
- **Why no node uses it.** Minimised in that metric, it holds in all 48 cells. So does the model's
  recursion since its long drives' bias is mended ([method.md](method.md), `without_velocity_bias`);
  "as it ships" above is without that. With every row the lifted statistic is no more efficient.
  It has no net, no named effects, one soil and no change of the ground yet. It stays a study,
  for what it says about long drives: [long_drives.md](long_drives.md) is where to look first.
"""


def page(lines: Sequence[Line], when: str, seed: int) -> str:
    """Return the whole page."""
    parts = [licence("recursion"), INTRODUCTION.format(measured=when, seed=seed)]
    for key in dict.fromkeys(_place_of(line) for line in lines):
        here = [line for line in lines if _place_of(line) == key]
        rover, rows, after_s = key
        title = f"## {rover}, {rows} after {after_s:g} s, {here[0].drives} drives"
        parts.append(f"{title}\n\n{_table(here)}\n")
    return "".join([*parts[:2], _verdicts(lines), *parts[2:]]).rstrip("\n") + "\n" + LEGEND + WHY


def _place_of(line: Line) -> tuple[str, str, float]:
    return line.rover, line.rows, line.after_s


BAND = (0.92, 0.98)
"""[1] Coverage of the 95 % interval that the stop rule asks for."""


def _verdicts(lines: Sequence[Line]) -> str:
    """Return a table of what each method reaches in all its lines."""
    every = []
    for method in methods():
        here = [each for line in lines if line.method == method for each in _parameters(line)]
        shares = [each.inside_95 for each in here]
        missed = sum(share.high < BAND[0] or share.low > BAND[1] for share in shares)
        low, high = (100 * pick(share.value for share in shares) for pick in (min, max))
        every.append(
            [
                method,
                f"{low:.1f} to {high:.1f}",
                f"{missed} of {len(shares)}",
                f"{max(each.of_bound for each in here):.2f}",
                f"{max(abs(each.mean_z) for each in here):.2f}",
                f"{sum(each.alone for each in here)}, {sum(each.not_alone for each in here)}",
            ]
        )
    head = (
        "method",
        "in 95 %",
        "outside 92 to 98 % by the limits",
        "worst of bound",
        "largest mean z",
        "gained, lost",
    )
    return "## All figures in short\n\n" + table(head, every) + "\n"


def _parameters(line: Line) -> tuple[Scored, Scored]:
    return line.cohesion, line.tan_phi


def _table(lines: Sequence[Line]) -> str:
    names = ("error %", "of bound", "in 95 %", "in 68 %", "mean z", "gained, lost")
    every = (f"{name}: {what}" for name in PARAMETERS for what in names)
    return table(("method", *every, "clamped %"), map(_cells_of, lines))


def _cells_of(line: Line) -> list[str]:
    both = (*_said(line.cohesion), *_said(line.tan_phi))
    return [line.method, *both, f"{100 * line.clamped:.0f}"]


def _said(scored: Scored) -> list[str]:
    share = scored.inside_95
    return [
        f"{100 * scored.median_error:.1f}",
        f"{scored.of_bound:.2f}",
        f"{100 * share.value:.1f} ({100 * share.low:.1f} to {100 * share.high:.1f})",
        f"{100 * scored.inside_68.value:.1f}",
        f"{scored.mean_z:+.2f} ± {scored.mean_z_limit:.2f}",
        f"{scored.alone}, {scored.not_alone}",
    ]
