# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures and the page of ``make stream``."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import norm

from studies.accuracy.scores import share_of
from studies.limited import Limited
from studies.stream.drives import Streamed
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
class StrengthScore:
    """c or tan phi at the end of a drive."""

    median_error: float  # relative
    p90_error: float
    inside_95: Limited  # of the published interval
    identified: float


@dataclass(frozen=True, slots=True)
class SoilScore:
    """Drives whose most probable soil first had a probability of :data:`UNSURE`, and how it did."""

    drives: int
    right: int  # whose soil at that time was the one that is there
    probability: float  # [1] mean of theirs at that time


@dataclass(frozen=True, slots=True)
class StreamCell:
    """One line of the tables."""

    rover: str
    model: str
    soil: str
    spread: float
    drives: int
    refused: float  # share of observations
    cohesion: StrengthScore
    tan_phi: StrengthScore
    early: Forecasts
    settled: Forecasts
    soil_found: SoilScore


def score(rover: str, model: str, soil: str, spread: float, streamed: Streamed) -> StreamCell:
    """Return the figures of these drives."""
    cohesion, tan_phi = (_parameter(streamed, k) for k in range(2))
    border = round(SETTLED_S / TIME_STEP)
    parts = (slice(None, border), slice(border, None))
    early, settled = (
        _forecasts(streamed.innovation[:, part], streamed.variance[:, part]) for part in parts
    )
    refused = float(streamed.refused.sum() / streamed.observations.sum())
    return StreamCell(
        rover, model, soil, spread, len(streamed.truth), refused, cohesion, tan_phi, early, settled,
        _soil(streamed),
    )  # fmt: skip


def _soil(streamed: Streamed) -> SoilScore:
    """Judge each drive once, so that drives are independent."""
    low, high = UNSURE
    within = (streamed.soil_probability >= low) & (streamed.soil_probability <= high)
    drives = np.flatnonzero(within.any(1))
    first = within.argmax(1)[drives]
    right = int(streamed.soil_right[drives, first].sum())
    probability = streamed.soil_probability[drives, first]
    return SoilScore(len(drives), right, float(probability.mean()) if len(drives) else math.nan)


def _parameter(streamed: Streamed, k: int) -> StrengthScore:
    error = np.abs(streamed.mean[:, k] - streamed.truth[:, k]) / streamed.truth[:, k]
    median, high = np.quantile(error, (0.5, 0.9)).tolist()
    return StrengthScore(
        median,
        high,
        share_of(torch.from_numpy(streamed.inside_95[:, k] > 0.0)),
        float(streamed.identified[:, k].mean()),
    )


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


INTRODUCTION = """# The estimator as it ships

{measured}

How accurate are the estimates of the node's own estimator with default parameters, and are its
velocity predictions calibrated? The drives are simulated, over hills (S1), seed {seed}:
{drives} drives of 40 s for each rover, soil and kind of constants.

- Every row is used, that of the accelerometer too. Observations are screened and gated, and the
  published covariance is inflated where the ground may have changed.
- The models are {models}. They have to find the soil among three.
- Truth is from the prior: c (2.75 ± 1.3 kPa) and tan phi (0.6 ± 0.22), both above zero. "5 %":
  each of the six soil constants is wrong by up to 5 %, independently. A drive ends at its first
  stuck second.
- [accuracy.md](accuracy.md) judges more drives, in batches that bypass screening, gates and
  inflation.

## c and tan phi after 40 s

Errors are relative: median / 90th percentile. Coverages of the 95 % interval have 99 % limits.

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
    head = (
        *place,
        "c median / p90 %",
        "tan phi median / p90 %",
        "c in 95 %",
        "tan phi in 95 %",
        "c identified %",
        "tan phi identified %",
        "refused %",
    )
    ground = [[*_place(cell), *_ground(cell)] for cell in cells]
    names = (
        f"{name}{part}"
        for part in (", 0 to 5 s", ", 5 to 40 s")
        for name in ("in 95 %", "in 68 %", "spread", "calibration")
    )
    velocity = [
        [*_place(cell), *_predicted(cell.early), *_predicted(cell.settled), _yes(cell)]
        for cell in cells
    ]
    every = table(head, ground) + FORECAST + table((*place, *names, "93 to 97 %"), velocity) + WHY
    found = [[*_place(cell), *_soils([cell])] for cell in cells]
    found.append(["all", "", "", str(sum(cell.drives for cell in cells)), *_soils(cells)])
    every += SOILS + table((*place, "with such a soil", "mean probability %", "right %"), found)
    return licence("stream") + INTRODUCTION.format(**said) + every


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
    share = share_of(torch.arange(drives) < right)
    limits = f"{_percent(share.value)} ({_percent(share.low)} to {_percent(share.high)})"
    return [str(drives), _percent(mean), limits]


def _percent(value: float) -> str:
    return f"{100.0 * value:.1f}"


def _ground(cell: StreamCell) -> list[str]:
    both = (cell.cohesion, cell.tan_phi)
    errors = [f"{_percent(p.median_error)} / {_percent(p.p90_error)}" for p in both]
    covered = [
        f"{_percent(p.inside_95.value)} ({_percent(p.inside_95.low)} to"
        f" {_percent(p.inside_95.high)})"
        for p in both
    ]
    return [
        *errors,
        *covered,
        *(_percent(p.identified) for p in both),
        f"{100.0 * cell.refused:.2f}",
    ]


def _predicted(forecasts: Forecasts) -> tuple[str, ...]:
    return (
        _percent(forecasts.inside_95),
        _percent(forecasts.inside_68),
        f"{forecasts.spread:.2f}",
        f"{forecasts.calibration:.2f}",
    )


def _yes(cell: StreamCell) -> str:
    return "yes" if 0.93 <= cell.settled.inside_95 <= 0.97 else "**no**"
