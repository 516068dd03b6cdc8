# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures and the page of ``make long``."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from studies.limited import Limited
from studies.stream.drives import Streamed
from studies.stream.scores import StrengthScore, strength_score
from studies.stream.table import limited, share
from studies.stream.targets import LARGEST_SHIFT
from studies.tables import licence, table

COVERED = (0.92, 0.98)
"""[1] Coverage of the 95 % interval that is wanted."""


@dataclass(frozen=True, slots=True)
class LongLine:
    """One set of drives after one time."""

    rover: str
    spread: float  # [1] of the soil constants
    rows: str
    after_s: float
    drives: int
    cohesion: StrengthScore
    tan_phi: StrengthScore


def lines(
    rover: str, spread: float, times_s: Sequence[float], found: dict[str, Streamed]
) -> list[LongLine]:
    """Return a line for each row set and each time."""
    return [
        LongLine(
            rover,
            spread,
            rows,
            after,
            len(streamed.truth),
            strength_score(streamed, place, 0),
            strength_score(streamed, place, 1),
        )
        for rows, streamed in found.items()
        for place, after in enumerate(times_s)
    ]


PAGE = """# Long drives on one ground

{measured}

Do intervals hold where they have become narrow? Their width falls with the square root of time, a
shift of the rows to one side does not. The drives are simulated, on loose sand over hills (S1),
seed {seed}. c and tan phi are drawn from the models' prior. The estimator is the node's, compiled,
with the models that ship: it screens, gates and has to find the soil among three.

"""
SUMMARY = (
    *("rover", "constants", "rows", "after s", "drives", "covered %", "shift", "error %"),
    *("IDENTIFIED %", "targets missed after"),
)
TERMS = """
Of two figures the first is that of c, the second that of tan phi. All times stand below, with
limits.

- **Constants.** "5 %": each of the six soil constants is wrong by up to 5 %.
- **Rows.** v velocity, L load, M wheel torques; "all" has the moment balances and the
  accelerometer, too.
- **Error.** Median, relative; "of bound": over the Cramer-Rao bound of the same drives, which was
  not computed for an hour.
- **Covered.** Drives whose 95 % interval covers. A target is missed where the 99 % limits exclude
  it: {low:g} to {high:g} %.
- **Shift.** Mean of error over published deviation, 99 % limits. Target: at most {shift:g}.
- **IDENTIFIED.** Drives in which the parameter is.
"""


def page(found: Sequence[LongLine], when: str, seed: int) -> str:
    """Return the whole page."""
    low, high = (100.0 * limit for limit in COVERED)
    parts = (
        licence("long"),
        PAGE.format(measured=when, seed=seed),
        table(SUMMARY, map(_summed, _together(found))),
        TERMS.format(low=low, high=high, shift=LARGEST_SHIFT),
        "".join(f"\n## {name}\n\n{_details(lines)}" for name, lines in _by_rover(found)),
    )
    return "".join(parts)


def _together(found: Sequence[LongLine]) -> list[list[LongLine]]:
    """Return the lines of the same drives and rows, which differ in their times alone."""
    return [list(lines) for _, lines in itertools.groupby(found, _place)]


def _place(line: LongLine) -> tuple[str, float, str]:
    return line.rover, line.spread, line.rows


def _summed(group: Sequence[LongLine]) -> list[str]:
    """Return the cells of the lines of the same drives: the last time, and what any missed."""
    last = group[-1]
    pair = (last.cohesion, last.tan_phi)
    missed = [f"{line.after_s:g} s" for line in group if _missed_of(line)]
    return [
        *_cells_of_place(last),
        f"{last.after_s:g}",
        str(last.drives),
        " / ".join(f"{100.0 * score.inside_95.value:.0f}" for score in pair),
        " / ".join(f"{score.shift.value:+.2f}" for score in pair),
        " / ".join(f"{100.0 * score.median_error:.1f}" for score in pair),
        " / ".join(f"{100.0 * score.identified:.0f}" for score in pair),
        ", ".join(missed) or "none",
    ]


def _by_rover(found: Sequence[LongLine]) -> list[tuple[str, list[LongLine]]]:
    names = dict.fromkeys(line.rover for line in found)
    return [(name, [line for line in found if line.rover == name]) for name in names]


def _details(found: Sequence[LongLine]) -> str:
    columns = ("error %", "of bound", "covered %", "shift", "IDENTIFIED %")
    head = (
        *("constants", "rows", "after s", "drives"),
        *(f"{name} {column}" for name in ("c", "tan phi") for column in columns),
        "missed",
    )
    return table(head, map(_cells_of, found))


def _cells_of(line: LongLine) -> list[str]:
    scores = {"c": line.cohesion, "tan phi": line.tan_phi}
    texts = [text for score in scores.values() for text in _said(score)]
    place = (*_cells_of_place(line)[1:], f"{line.after_s:g}", str(line.drives))
    return [*place, *texts, ", ".join(_missed_of(line))]


def _cells_of_place(line: LongLine) -> tuple[str, str, str]:
    constants = f"{100.0 * line.spread:g} %" if line.spread else "exact"
    return line.rover.removesuffix("_rover"), constants, line.rows


def _missed_of(line: LongLine) -> list[str]:
    scores = {"c": line.cohesion, "tan phi": line.tan_phi}
    return [f"{name} {what}" for name, score in scores.items() for what in _missed(score)]


def _said(score: StrengthScore) -> tuple[str, ...]:
    ratio = score.of_bound.value
    return (
        f"{100.0 * score.median_error:.1f}",
        "" if math.isnan(ratio) else f"{ratio:.2f}",
        share(score.inside_95),
        limited(score.shift, 2),
        f"{100.0 * score.identified:.0f}",
    )


def _missed(score: StrengthScore) -> list[str]:
    wanted = (
        ("covered", score.inside_95, *COVERED),
        ("shift", score.shift, -LARGEST_SHIFT, LARGEST_SHIFT),
    )
    return [name for name, found, low, high in wanted if _outside(found, low, high)]


def _outside(found: Limited, low: float, high: float) -> bool:
    return found.high < low or found.low > high
