# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures and the page of ``make long``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from scipy.stats import norm

from studies.accuracy.cells import CellBatch, Setting
from studies.accuracy.scores import CONFIDENCE, HALF_NORMAL_MEDIAN, Judged, pool, share_of
from studies.limited import Limited
from studies.tables import licence, table

COVERED = (0.92, 0.98)
"""[1] Coverage of the 95 % interval that is wanted."""
MOST_SHIFT = 0.3
"""[published deviations] Largest mean of error over deviation that is wanted."""


@dataclass(frozen=True, slots=True)
class LongScore:
    """One parameter after one time."""

    median_error: float  # relative
    of_bound: float  # median error over the Cramer-Rao bound, 1 for an efficient estimator
    covered: Limited  # by the 95 % interval
    shift: Limited  # mean error over published deviation


@dataclass(frozen=True, slots=True)
class LongLine:
    """One set of drives after one time."""

    rover: str
    spread: float  # [1] of the soil constants
    rows: str
    after_s: float
    drives: int
    cohesion: LongScore
    tan_phi: LongScore


def lines(setting: Setting, parts: Sequence[CellBatch]) -> list[LongLine]:
    """Return a line for each row set and each time of a setting."""
    found = []
    for rows in setting.rows:
        judged = pool([part.judged[rows, "physics"] for part in parts])
        for place, after in enumerate(setting.times_s):
            both = (_scored(judged, place, 0), _scored(judged, place, 1))
            drives = len(judged.truth)
            found.append(LongLine(setting.rover, setting.spread, rows, after, drives, *both))
    return found


def _scored(judged: Judged, place: int, parameter: int) -> LongScore:
    truth, least = judged.truth[:, parameter], judged.least[:, place, parameter]
    error = judged.mean[:, place, parameter] - truth
    z = error / judged.covariance[:, place, parameter, parameter].sqrt()
    half = norm.isf(0.5 * (1.0 - CONFIDENCE)) * float(z.std()) / math.sqrt(len(z))
    mean = float(z.mean())
    return LongScore(
        float((error.abs() / truth).median()),
        float((error.abs() / least).median()) / HALF_NORMAL_MEDIAN,
        share_of(torch.le(z.abs(), norm.ppf(0.975))),
        Limited(mean, mean - half, mean + half),
    )


PAGE = """# Long drives on one ground

{measured}

Do intervals hold where they have become narrow? Their width falls with the square root of time, a
shift of the rows to one side does not. The drives are simulated, on loose sand over hills (S1),
seed {seed}. c and tan phi are drawn from the models' prior, the soil is known, there is no net.

"""
TERMS = """
- **Constants.** "5 %": each of the six soil constants is wrong by up to 5 %, and is a parameter.
- **Rows.** v velocity, L load, M wheel torques, B moment balances.
- **Error.** Median, relative; "of bound": over the Cramer-Rao bound of the same drives.
- **Covered.** Drives whose 95 % interval covers. A target is missed where the 99 % limits exclude
  it: {low:g} to {high:g} %.
- **Shift.** Mean of error over published deviation, 99 % limits. Target: at most {shift:g}.
"""


def page(found: Sequence[LongLine], when: str, seed: int) -> str:
    """Return the whole page."""
    low, high = (100.0 * share for share in COVERED)
    head = (
        "rover", "constants", "rows", "after s", "drives", "c error %", "c of bound",
        "c covered %", "c shift", "tan phi error %", "tan phi of bound", "tan phi covered %",
        "tan phi shift", "missed",
    )  # fmt: skip
    parts = (
        licence("long"),
        PAGE.format(measured=when, seed=seed),
        table(head, map(_cells_of, found)),
        TERMS.format(low=low, high=high, shift=MOST_SHIFT),
    )
    return "".join(parts)


def _cells_of(line: LongLine) -> list[str]:
    scores = {"c": line.cohesion, "tan phi": line.tan_phi}
    texts = [text for score in scores.values() for text in _said(score)]
    missed = [f"{name} {what}" for name, score in scores.items() for what in _missed(score)]
    constants = f"{100.0 * line.spread:g} %" if line.spread else "exact"
    place = (line.rover.removesuffix("_rover"), constants, line.rows, f"{line.after_s:g}")
    return [*place, str(line.drives), *texts, ", ".join(missed)]


def _said(score: LongScore) -> tuple[str, ...]:
    covered, shift = score.covered, score.shift
    return (
        f"{100.0 * score.median_error:.1f}",
        f"{score.of_bound:.2f}",
        f"{100.0 * covered.value:.1f} ({100.0 * covered.low:.1f} to {100.0 * covered.high:.1f})",
        f"{shift.value:+.2f} ({shift.low:+.2f} to {shift.high:+.2f})",
    )


def _missed(score: LongScore) -> list[str]:
    low, high = COVERED
    outside = score.covered.high < low or score.covered.low > high
    shifted = score.shift.low > MOST_SHIFT or score.shift.high < -MOST_SHIFT
    return [name for name, bad in (("covered", outside), ("shift", shifted)) if bad]
