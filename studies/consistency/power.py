# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""False alarms of the test on honest drives, and its power where something is wrong."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.stats import chi2

from studies.consistency.sequences import Record, closed
from studies.consistency.windows import (
    WINDOWS,
    Calibration,
    Floats,
    alarms,
    calibrated,
    delays,
    score,
    threshold_for,
)
from studies.foreign.residuals import kinds, whitened
from studies.tables import table

RATE = 0.5
"""[1/h] False alarms that the threshold is chosen for: half of the one an hour that is allowed."""
HOUR = 3600.0
FAR = 3.0
"""[deviations] A drive further from the truth at its end is one that must not be missed."""


@dataclass(frozen=True, slots=True)
class AlarmRate:
    """False alarms of honest drives."""

    alarms: int
    hours: float

    @property
    def limits(self) -> tuple[float, float]:
        """Exact Poisson limits of the rate, 95 % [1/h]."""
        low = chi2.ppf(0.025, 2 * self.alarms) / 2.0 if self.alarms else 0.0
        return float(low) / self.hours, float(chi2.ppf(0.975, 2 * self.alarms + 2)) / (
            2.0 * self.hours
        )

    def __str__(self) -> str:
        """Return count, hours, rate and limits."""
        low, high = self.limits
        return (
            f"{self.alarms} in {self.hours:.1f} h: {self.alarms / self.hours:.2f} an hour"
            f" ({low:.2f} to {high:.2f})"
        )


@dataclass(frozen=True, slots=True)
class Power:
    """The test where something is wrong."""

    name: str
    drives: int
    found: int  # drives with an alarm
    after_s: tuple[float, float]  # quartile and median of the time to it, infinite where none
    far: int  # drives that end more than FAR off; -1 where that is not known
    far_missed: int  # of these without an alarm
    statistic: str  # most frequent first one


@dataclass(frozen=True, slots=True)
class JudgedTest:
    """The test with its calibration and threshold."""

    calibrations: tuple[Calibration, ...]
    threshold: float
    chosen: AlarmRate  # of the half that the threshold was chosen on
    judged: AlarmRate  # of the other half

    def power(self, name: str, records: Sequence[Record]) -> Power:
        """Return the power on the drives of some records."""
        if not records:
            return Power(name, 0, 0, (np.inf, np.inf), -1, 0, "")
        white = _joined(records)
        values, which = score(white, list(self.calibrations))
        delay = delays(values, self.threshold)
        z = [np.abs(each["mean"] - each["truth"]) / each["deviation"] for each in records]
        far = np.concatenate(z).max(1) > FAR
        seen = np.isfinite(delay)
        first = [which[k, int(delay[k]) - 1] for k in np.flatnonzero(seen)]
        times = np.sort(delay)
        quartiles = (float(times[len(times) // 4]), float(times[len(times) // 2]))
        return Power(
            name,
            len(delay),
            int(seen.sum()),
            quartiles,
            int(far.sum()),
            int((far & ~seen).sum()),
            _statistic(int(np.bincount(first).argmax())) if first else "",
        )

    def page(self, commit: str) -> str:
        """Return what was chosen and judged."""
        rows = (
            [
                f"{c.length}",
                name,
                f"{c.deviation[k]:.2f}",
                f"{c.scale[k]:.2f}",
                f"{c.degrees[k]:.1f}",
            ]
            for c in self.calibrations
            for k, name in enumerate(kinds(3))
        )
        head = ("window [s]", "row", "deviation of the sum", "scale of NIS", "degrees of NIS")
        return (
            f"# A test of consistency\n\nCommit {commit}. Windows of {WINDOWS} blocks; threshold"
            f" {self.threshold:.2f} = -log10 of the probability of the most surprising of"
            f" {len(WINDOWS) * (2 * len(kinds(3)) + 1)} statistics.\n\n"
            f"- half that it was chosen on: {self.chosen}\n- other half: {self.judged}\n\n"
            f"{table(head, rows)}\n"
        )


def judge(first: Sequence[Record], second: Sequence[Record]) -> JudgedTest:
    """Return the test with the threshold of one half of the honest drives, judged on the other."""
    white, other = _joined(first), _joined(second)
    known = [calibrated(white, length) for length in WINDOWS]
    hours = [sum(map(closed, records)) / HOUR for records in (first, second)]
    values = score(white, known)[0]
    threshold = threshold_for(values, hours[0], RATE)
    return JudgedTest(
        tuple(known),
        threshold,
        AlarmRate(int(alarms(values, threshold).sum()), hours[0]),
        AlarmRate(int(alarms(score(other, known)[0], threshold).sum()), hours[1]),
    )


def _joined(records: Sequence[Record]) -> Floats:
    """Return the innovations of all records [N, B, Q], as long as the longest."""
    most = max(each["white"].shape[1] for each in records)
    padded = [
        np.pad(each["white"], ((0, 0), (0, most - each["white"].shape[1]), (0, 0)),
               constant_values=np.nan)
        for each in records
    ]  # fmt: skip
    return np.concatenate(padded)


def _statistic(index: int) -> str:
    """Return the name of one of the statistics of :func:`score`."""
    names = [*(f"sum of {row}" for row in kinds(3)), *(f"NIS of {row}" for row in kinds(3))]
    names.append("NIS of all rows")
    return f"{names[index % len(names)]}, {WINDOWS[index // len(names)]} s"


def foreign_power(judged: JudgedTest, folder: Path) -> Iterator[Power]:
    """Yield the power on the foreign logs by model and law, from the records of make foreign."""
    files = sorted(folder.glob("*/*.npz"))
    groups = sorted({_group(path) for path in files})
    for group in groups:
        records = [_foreign(path) for path in files if _group(path) == group]
        yield judged.power(f"foreign, {group}", records)


def _group(path: Path) -> str:
    model, log, _ = path.stem.split("-")
    return f"{model}, {log.split('_')[2]}"


def _foreign(path: Path) -> Record:
    with np.load(path) as stored:
        record = dict(stored)
    innovation, spread = (torch.from_numpy(record[name]) for name in ("leading", "spread"))
    moments = {name: record[name][np.newaxis] for name in ("mean", "deviation", "truth")}
    return moments | {"white": whitened(innovation, spread).numpy()[np.newaxis]}


def page(powers: Sequence[Power]) -> str:
    """Return the table of the power."""
    head = ("case", "drives", "with an alarm", "quartile / median of the time [s]")
    lines = (
        [
            each.name,
            f"{each.drives}",
            f"{each.found}",
            " / ".join(map(_seconds, each.after_s)),
            f"{each.far}",
            f"{each.far_missed}",
            each.statistic,
        ]
        for each in powers
    )
    return table((*head, "end far from the truth", "of these unseen", "first seen by"), lines)


def _seconds(value: float) -> str:
    return f"{value:.0f}" if np.isfinite(value) else "-"
