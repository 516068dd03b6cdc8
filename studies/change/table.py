# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page of ``make change``."""

import math
from dataclasses import dataclass

from studies.accuracy.scores import CONFIDENCE
from studies.change.drives import ALARM, FalseAlarms
from studies.change.scores import AFTER_S, SETTLING_S, ChangeScore, rate_limits
from studies.limited import Limited
from studies.tables import licence, table

FOUND_WITHIN_S = 3.0
KNOWN_WITHIN_S = 15.0
ALARMS_PER_HOUR = 0.2
DISAGREEMENTS_PER_HOUR = 1.0
COVERED_GRADUALLY = 0.9
FEWEST_JUDGED = 100
"""Drives of a change below which its limits exclude too little for a verdict."""


@dataclass(frozen=True, slots=True)
class ChangeRun:
    """All results of one run of ``change``."""

    measured: str  # date, commit and code, as :func:`docs.provenance.measured` writes them
    drives: int  # planned for each change
    hours: float  # planned on constant ground for each rover
    seed: int
    models: list[str]
    changes: list[ChangeScore]
    constant: list[FalseAlarms]


INTRODUCTION = """# Ground that changes

{measured}

How soon does the estimator detect a change of the ground? How long until the new estimate is as
good as a fresh one? How often does it raise a false alarm? The drives are simulated, over hills
(S1), with every row, seed {seed}. The models have all three soils:
{models}. Planned are {drives} drives of each change, and {hours:g} hours on
constant ground for each rover. The tables have the numbers that were driven.

"""
TERMS = """## How the drives are judged

- **Truth** on both sides is drawn from the model's prior, c 0.5 to 5 kPa and phi 15 to 45 deg. Each
  soil constant is wrong by up to 5 %. "Loose to loose" moves c and phi by half of these ranges.
  In a gradual change the truth is the mean over the axles.
- **Time** counts from the moment at which the first axle crosses.
- **Crossing**: the median time until the last axle is on the new ground (behind the transition,
  where the change is gradual).
- **Detected**: the time until `change_probability` rises above {alarm:g}, with {confidence:g} %
  limits from order statistics. A rise before the crossing is a false alarm. A probability that is
  already above {alarm:g} at the crossing does not count as detected.
- **Known again**: the first second after the last axle's crossing from which on two conditions
  hold for {after} s. The median error is at most 1.3 times that of an estimator that starts when
  the last axle has crossed ("fresh"). The coverage of the 95 % interval is at least nominal. Both
  fail only where their {confidence:g} % limits exclude it.
- **Covered**: share of the time in which the 95 % interval covers, from the first axle's crossing
  until {settling} s after the last one's.
- **Not judged**: a target that is met with fewer than {fewest} drives, whose limits exclude little.
- **Drives**: all, those that still drive after 15 s, and those that still drive after 40 s. Drives
  that get stuck, or that end within 20 s of the last axle's crossing, are drawn anew.

"""


def page(run: ChangeRun) -> str:
    """Return the whole page."""
    introduction = INTRODUCTION.format(
        measured=run.measured,
        models=", ".join(run.models),
        seed=run.seed,
        drives=run.drives,
        hours=run.hours,
    )
    parts = [
        licence("change")
        + introduction
        + "## Targets\n\n"
        + table(("what", "target", "found", "met"), _targets(run)),
        TERMS.format(
            alarm=ALARM,
            confidence=100.0 * CONFIDENCE,
            after=AFTER_S,
            settling=SETTLING_S,
            fewest=FEWEST_JUDGED,
        )
        + "## Changes\n\n"
        + _changes(run.changes),
        "## False words on constant ground and before a change\n\n" + _alarms(run),
    ]
    return "\n".join(parts)


def _name(score: ChangeScore) -> str:
    before, after = (
        soil.removesuffix("_sand") for soil in (score.change.before, score.change.after)
    )
    return (
        f"{before} to {after}"
        + (f", {score.change.gradual_s:g} s" if score.change.gradual_s else "")
        + (f", forgetting {score.change.forgetting_s:g} s" if score.change.forgetting_s else "")
    )


def _yes(met: bool, drives: int = FEWEST_JUDGED) -> str:  # noqa: FBT001 (its name is the function's)
    """Return the verdict; what is missed with few drives is missed all the same."""
    if not met:
        return "**no**"
    return "yes" if drives >= FEWEST_JUDGED else "not judged"


def _targets(run: ChangeRun) -> list[tuple[str, str, str, str]]:
    lines = []
    for score in run.changes:
        if score.change.gradual_s == 0.0:
            where = f"{score.change.rover}, {_name(score)}"
            median, recovered = score.delay_median_s.value, max(score.recovered_s)
            lines.append(
                (
                    f"detected, median, {where}",
                    f"{FOUND_WITHIN_S:g} s",
                    _time(median),
                    _yes(median <= FOUND_WITHIN_S, score.drives[0]),
                )
            )
            lines.append(
                (
                    f"known again after the last axle, {where}",
                    f"{KNOWN_WITHIN_S:g} s",
                    _time(recovered),
                    _yes(recovered <= KNOWN_WITHIN_S, score.drives[0]),
                )
            )
        else:
            least = min(score.covered, key=lambda share: share.high)
            lines.append(
                (
                    f"covered, {score.change.rover}, {_name(score)}",
                    f"{100.0 * COVERED_GRADUALLY:g} %",
                    f"{_percent(least)} %",
                    _yes(least.high >= COVERED_GRADUALLY, score.drives[0]),
                )
            )
    every = [
        *run.constant,
        *(score.before for score in run.changes if not score.change.forgetting_s),
    ]
    for rover, alarms, disagreements, hours in _totals(every):
        for what, count, target in (
            ("false alarms", alarms, ALARMS_PER_HOUR),
            ("false DISAGREES", disagreements, DISAGREEMENTS_PER_HOUR),
        ):
            low, high = rate_limits(count, hours)
            said = f"{count / hours:.2f} in {hours:.1f} h ({low:.2f} to {high:.2f})"
            lines.append((f"{what} an hour, {rover}", f"{target:g}", said, _yes(low <= target)))
    return lines


def _changes(scores: list[ChangeScore]) -> str:
    head = (
        "rover", "change", "drives", "crossing s", "detected %", "detected median s",
        "detected p90 s", "known again s, c / tan phi", "covered %, c", "covered %, tan phi",
        "error after 15 s %, c / tan phi",
        "fresh error after 15 s %", "in 95 % after 15 s, c / tan phi", "in 95 % after 40 s",
    )  # fmt: skip
    lines = []
    for score in scores:
        line = [
            score.change.rover.removesuffix("_rover"),
            _name(score),
            " / ".join(map(str, score.drives)),
        ]
        line += [f"{score.crossing_s:.1f}", f"{100.0 * score.detected:.0f}"]
        line += [
            _quantile(score.delay_median_s),
            _quantile(score.delay_p90_s),
            " / ".join(map(_seconds, score.recovered_s)),
            *map(_percent, score.covered),
        ]
        line += [
            _both(values, 100.0, 1)
            for values in (
                score.error_15_s,
                score.fresh_15_s,
                score.coverage_15_s,
                score.coverage_40_s,
            )
        ]
        lines.append(line)
    return table(head, lines)


def _quantile(quantile: Limited) -> str:
    return f"{_seconds(quantile.value)} ({_seconds(quantile.low)} to {_seconds(quantile.high)})"


def _percent(share: Limited) -> str:
    return f"{100.0 * share.value:.1f} ({100.0 * share.low:.1f} to {100.0 * share.high:.1f})"


def _seconds(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "never"


def _time(value: float) -> str:
    return f"{value:.1f} s" if math.isfinite(value) else "never"


def _both(values: tuple[float, float], factor: float, digits: int) -> str:
    return " / ".join(f"{factor * value:.{digits}f}" for value in values)


def _alarms(run: ChangeRun) -> str:
    head = ("rover", "soil", "drives", "hours", "alarms", "an hour", "limits", "DISAGREES")
    entries = [(entry, "constant") for entry in run.constant] + [
        (score.before, f"before {_name(score)}") for score in run.changes
    ]
    lines = []
    for entry, drives in entries:
        low, high = rate_limits(entry.alarms, entry.hours)
        rate = f"{entry.alarms / entry.hours:.2f}"
        lines.append(
            [
                entry.rover,
                entry.soil,
                drives,
                f"{entry.hours:.1f}",
                str(entry.alarms),
                rate,
                f"{low:.2f} to {high:.2f}",
                str(entry.disagreements),
            ]
        )
    return table(head, lines)


def _totals(entries: list[FalseAlarms]) -> list[tuple[str, int, int, float]]:
    """Return rover, alarms, disagreements and hours over all soils."""
    rovers = list(dict.fromkeys(entry.rover for entry in entries))
    chosen = [[entry for entry in entries if entry.rover == rover] for rover in rovers]
    return [
        (
            rover,
            sum(e.alarms for e in part),
            sum(e.disagreements for e in part),
            sum(e.hours for e in part),
        )
        for rover, part in zip(rovers, chosen, strict=True)
    ]
