# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures and the page of ``make stream``."""

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import norm

from studies.accuracy.scores import share_of
from studies.limited import Limited
from studies.stream.drives import EVERY_ROW, Streamed
from studies.stream.scores import StrengthScore, strength_score
from studies.stream.targets import FEWEST, TARGETS, worst_of
from studies.tables import licence, table
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import Noise

SETTLED_S = 5.0
"""[s] Predictions before and after this time are judged separately."""
UNSURE = (0.85, 0.95)
"""[1] Probabilities of a soil that should be right as often as they say."""


@dataclass(frozen=True, slots=True)
class Forecasts:
    """Measured velocities beside their predictions."""

    count: int
    inside_95: float  # share in the 95 % interval
    inside_68: float
    spread: float  # median predicted deviation over the noise of the velocity sensor [1]
    calibration: float  # rms predicted deviation over rms innovation [1]


@dataclass(frozen=True, slots=True)
class SoilScore:
    """Drives whose most probable soil first had a probability of :data:`UNSURE`, and how it did."""

    drives: int
    right: int  # whose soil at that time was the one that is there
    probability: float  # [1] mean of theirs at that time


@dataclass(frozen=True, slots=True)
class RowsScore:
    """c and tan phi with one set of rows."""

    rows: str
    refused: float  # share of observations
    cohesion: StrengthScore
    tan_phi: StrengthScore


@dataclass(frozen=True, slots=True)
class StreamCell:
    """One rover on one soil; forecasts and the soil are those with every row."""

    rover: str
    model: str
    soil: str
    spread: float
    drives: int
    strength: tuple[RowsScore, ...]
    early: Forecasts
    settled: Forecasts
    soil_found: SoilScore


def score(
    rover: str, model: str, soil: str, spread: float, found: Mapping[str, Streamed]
) -> StreamCell:
    """Return the figures of these drives with each set of rows."""
    strength = tuple(_with_rows(rows, streamed) for rows, streamed in found.items())
    streamed = found[EVERY_ROW]
    border = round(SETTLED_S / TIME_STEP)
    parts = (slice(None, border), slice(border, None))
    early, settled = (
        _forecasts(streamed.innovation[:, part], streamed.variance[:, part]) for part in parts
    )
    return StreamCell(
        rover, model, soil, spread, len(streamed.truth), strength, early, settled, _soil(streamed)
    )


def _with_rows(rows: str, streamed: Streamed) -> RowsScore:
    cohesion, tan_phi = (strength_score(streamed, -1, k) for k in range(2))
    refused = float(streamed.refused.sum() / streamed.observations.sum())
    return RowsScore(rows, refused, cohesion, tan_phi)


def _soil(streamed: Streamed) -> SoilScore:
    """Judge each drive once, so that drives are independent."""
    low, high = UNSURE
    within = (streamed.soil_probability >= low) & (streamed.soil_probability <= high)
    drives = np.flatnonzero(within.any(1))
    first = within.argmax(1)[drives]
    right = int(streamed.soil_right[drives, first].sum())
    probability = streamed.soil_probability[drives, first]
    return SoilScore(len(drives), right, float(probability.mean()) if len(drives) else math.nan)


def _forecasts(innovation: NDArray[np.float64], variance: NDArray[np.float64]) -> Forecasts:
    made = np.isfinite(innovation)
    squared, variance = innovation[made] ** 2, variance[made]
    inside_95, inside_68 = (
        float((squared < norm.ppf(quantile) ** 2 * variance).mean()) for quantile in (0.975, 0.84)
    )
    spread = float(np.median(np.sqrt(variance))) / Noise().velocity
    return Forecasts(
        int(made.sum()), inside_95, inside_68, spread, math.sqrt(variance.mean() / squared.mean())
    )


ERROR_COLUMNS = ("median / p90 %", "bound %", "of bound")
INTERVAL_COLUMNS = ("in 95 %", "in 68 %", "shift", "IDENTIFIED %", "IDENTIFIED, of known %")
INTRODUCTION = """# The estimator as it ships

{measured}

How accurate are the estimates of the node's own estimator with default parameters, and are its
velocity predictions calibrated? The drives are simulated, over hills (S1), seed {seed}:
{drives} drives of 40 s for each rover, soil and kind of constants.

- Rows: v velocity, L load, M wheel torques; "all" has the moment balances and the accelerometer,
  too, as with the node's default parameters. Predictions and soils are those with all.
- Observations are screened and gated, and the published covariance is inflated where the ground may
  have changed.
- The models are {models}. They have to find the soil among three.
- Truth is from the prior: c (2.75 ± 1.3 kPa) and tan phi (0.6 ± 0.22), both above zero. "5 %":
  each of the six soil constants is wrong by up to 5 %, independently. A drive ends at its first
  stuck second.
- [accuracy.md](accuracy.md) judges velocity alone and other drives, in batches that bypass
  screening, gates and inflation; [long_drives.md](long_drives.md) judges minutes and an hour.

## Targets

A target is missed where the 99 % limits of the worst cell exclude it.

"""
ERRORS = """
## Errors after 40 s

Errors are relative: median / 90th percentile. The bound is the median error of an estimator that
reaches that of Cramer and Rao on the same drives. "Of bound" is the median over the drives of error
over bound, 1 for an efficient estimator. Brackets are 99 % limits.

"""
INTERVALS = """
## Intervals and status after 40 s

- **In 68 %**: within one published deviation, of the drives that published an estimate.
- **Shift**: mean of error over published deviation.
- **IDENTIFIED, of known**: of the drives whose bound leaves at most a tenth of the prior's
  variance.

"""
FORECAST = """
## The predicted velocity

Each `motion_prediction` is compared with the next measured velocity. The target is a coverage of
93 to 97 % of the 95 % interval after 5 s. In the first 5 s each drive has only 47 predictions, too
few for a verdict on a cell.

- **Spread**: the median predicted deviation over that of the velocity sensor.
- **Calibration**: the rms predicted deviation over the rms innovation; 1 is right.

"""
SOILS = """
## The most probable soil

Is a soil with a probability of 85 to 95 % the right one in 85 to 95 % of the drives? Each drive
counts once: at the first time at which its most probable soil has such a probability.

"""
WHY = """
A prediction is made before the slip and sinkage of its own sample are measured, so its deviation is
larger than the velocity sensor's. It contains the deviation of the present velocity, that of the
force that follows from slip and sinkage, and the change of the force within a sample. After a gap
the acceleration is unknown, and the prediction is not valid until the next sample.
"""


def page(cells: list[StreamCell], measured: str, seed: int) -> str:
    """Return the whole page."""
    said = {
        "measured": measured,
        "seed": seed,
        "drives": min(cell.drives for cell in cells),
        "models": " and ".join(dict.fromkeys(c.model for c in cells)),
    }
    place = ("rover", "soil", "constants", "drives")
    names = (
        f"{name}{part}"
        for part in (", 0 to 5 s", ", 5 to 40 s")
        for name in ("in 95 %", "in 68 %", "spread", "calibration")
    )
    velocity = [
        [*_place(cell), *_predicted(cell.early), *_predicted(cell.settled), _yes(cell)]
        for cell in cells
    ]
    every = table(("what", "target", "found", "cell", "met"), target_lines(cells))
    lines = [(cell, each) for cell in cells for each in cell.strength]
    head = (*place, "rows", *_both(ERROR_COLUMNS), "refused %")
    every += ERRORS + table(head, (_errors(*line) for line in lines))
    head = (*place, "rows", *_both(INTERVAL_COLUMNS))
    every += INTERVALS + table(head, (_intervals(*line) for line in lines))
    every += FORECAST + table((*place, *names, "93 to 97 %"), velocity) + WHY
    found = [[*_place(cell), *_soils([cell])] for cell in cells]
    found.append(["all", "", "", str(sum(cell.drives for cell in cells)), *_soils(cells)])
    every += SOILS + table((*place, "with such a soil", "mean probability %", "right %"), found)
    return licence("stream") + INTRODUCTION.format(**said) + every


def target_lines(cells: list[StreamCell]) -> list[list[str]]:
    """Return what is wanted, the cell that is farthest off, and whether all cells are met."""
    scores = [
        (f"{name}, {' '.join(_place(cell)[:3])}, {each.rows}", parameter)
        for cell in cells
        for each in cell.strength
        for name, parameter in (("c", each.cohesion), ("tan phi", each.tan_phi))
    ]
    lines = []
    for target in TARGETS:
        worst = worst_of(target, scores)
        if worst is None:
            lines.append([target.what, target.text, "", "no such cell", "not judged"])
            continue
        percent = "%" in target.text
        found = f"{share(worst.found)} %" if percent else limited(worst.found, 2)
        missed = f"**no**, {worst.missed} of {worst.cells} cells" if worst.missed else "yes"
        judged = min(cell.drives for cell in cells) >= FEWEST
        lines.append(
            [target.what, target.text, found, worst.cell, missed if judged else "not judged"]
        )
    return lines


def _place(cell: StreamCell) -> tuple[str, ...]:
    return (
        cell.rover.removesuffix("_rover"),
        cell.soil.removesuffix("_sand"),
        "5 %" if cell.spread else "exact",
        str(cell.drives),
    )


def _soils(cells: list[StreamCell]) -> list[str]:
    scores = [cell.soil_found for cell in cells if cell.soil_found.drives]
    drives, right = (sum(getattr(each, name) for each in scores) for name in ("drives", "right"))
    if not drives:
        return ["0", "", ""]
    mean = sum(each.drives * each.probability for each in scores) / drives
    return [str(drives), _percent(mean), share(share_of(torch.arange(drives) < right))]


def _percent(value: float) -> str:
    return f"{100.0 * value:.1f}"


def _both(columns: tuple[str, ...]) -> list[str]:
    return [f"{name} {column}" for name in ("c", "tan phi") for column in columns]


def _errors(cell: StreamCell, found: RowsScore) -> list[str]:
    texts = []
    for each in (found.cohesion, found.tan_phi):
        texts.append(f"{_percent(each.median_error)} / {_percent(each.p90_error)}")
        texts += [_percent(each.bound), limited(each.of_bound, 2)]
    return [*_place(cell), found.rows, *texts, f"{100.0 * found.refused:.2f}"]


def _intervals(cell: StreamCell, found: RowsScore) -> list[str]:
    texts = []
    for each in (found.cohesion, found.tan_phi):
        texts += [share(each.inside_95), share(each.inside_68), limited(each.shift, 2)]
        texts += [_percent(each.identified), _of_known(each)]
    return [*_place(cell), found.rows, *texts]


def _of_known(score: StrengthScore) -> str:
    return f"{share(score.identified_of_known)} of {score.known}" if score.known else ""


def share(found: Limited | None) -> str:
    """Return a share in percent with its limits, nothing where there is none."""
    return limited(Limited(*(100.0 * x for x in astuple(found))), 1) if found else ""


def limited(found: Limited, digits: int) -> str:
    """Return a figure with its limits."""
    return f"{found.value:.{digits}f} ({found.low:.{digits}f} to {found.high:.{digits}f})"


def _predicted(forecasts: Forecasts) -> tuple[str, ...]:
    return (
        _percent(forecasts.inside_95),
        _percent(forecasts.inside_68),
        f"{forecasts.spread:.2f}",
        f"{forecasts.calibration:.2f}",
    )


def _yes(cell: StreamCell) -> str:
    return "yes" if 0.93 <= cell.settled.inside_95 <= 0.97 else "**no**"
