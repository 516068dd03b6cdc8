# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of ``stream_study`` and their page in Markdown."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import norm

from studies.accuracy.scores import Share, share_of
from studies.stream.drives import Streamed
from studies.tables import LICENCE, table
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import TIME_STEP

SETTLED_S = 5.0
"""[s] Forecasts before and after this time are judged apart."""


@dataclass(frozen=True, slots=True)
class Forecasts:
    """Velocities that came, beside what was foretold."""

    count: int
    inside_95: float  # share in the 95 % interval
    inside_68: float
    spread: float  # median foretold deviation over the noise of the velocity sensor [1]
    calibration: float  # rms foretold deviation over rms innovation [1]


@dataclass(frozen=True, slots=True)
class StrengthScore:
    """c or tan phi at the end of a drive."""

    median_error: float  # relative
    p90_error: float
    inside_95: Share  # of the published interval
    identified: float


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


def score(rover: str, model: str, soil: str, spread: float, streamed: Streamed) -> StreamCell:
    """The figures of these drives."""
    cohesion, tan_phi = (_parameter(streamed, k) for k in range(2))
    border = round(SETTLED_S / TIME_STEP)
    parts = (slice(None, border), slice(border, None))
    early, settled = (
        _forecasts(streamed.innovation[:, part], streamed.variance[:, part]) for part in parts
    )
    refused = float(streamed.refused.sum() / streamed.observations.sum())
    return StreamCell(
        rover, model, soil, spread, len(streamed.truth), refused, cohesion, tan_phi, early, settled
    )


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


_INTRODUCTION = """# The estimator as it ships

Written by `make stream` on {date}, seed {seed}: {drives} drives of 40 s over hills for each rover, soil and kind of constants, through the
node's own estimator with default parameters. Every row is used, that of the accelerometer too, observations are screened and gated, and
what is published is doubted where the ground may have changed. The models are {models}; they have to find the soil among three.
[accuracy.md](accuracy.md) judges more drives, in batches that bypass all this.

Truth is uniform in c 0.5 to 5 kPa and phi 15 to 45 deg; "5 %": each of the six soil constants is wrong by up to 5 %, independently. A drive
ends at its first stuck second.

"""
_FORECAST = """
## The velocity that is foretold

Each `motion_prediction` against the next measured velocity; the target is 93 to 97 % in the 95 % interval after 5 s. Before, each drive has
47 forecasts alone, too few for a verdict on a cell. Spread is the median foretold deviation over that of the velocity sensor,
calibration the rms foretold deviation over the rms innovation (1 is right).

"""
_WHY = """
A forecast is made before the slip and sinkage of its own sample are known, so its deviation is larger than the velocity sensor's: that
of the velocity now, of the force as slip and sinkage tell it, and of what the force changes by within a sample. After a gap no
acceleration is known, and the prediction is not valid until the next sample.
"""


def page(cells: list[StreamCell], date: str, seed: int) -> str:
    """The whole page."""
    said = {
        "date": date,
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
        [*_place(cell), *_foretold(cell.early), *_foretold(cell.settled), _yes(cell)]
        for cell in cells
    ]
    every = (
        "## c and tan phi after 40 s\n\n"
        + table(head, ground)
        + _FORECAST
        + table((*place, *names, "93 to 97 %"), velocity)
        + _WHY
    )
    return LICENCE + _INTRODUCTION.format(**said) + every


def _place(cell: StreamCell) -> tuple[str, ...]:
    return (
        cell.rover.removesuffix("_rover"),
        cell.soil.removesuffix("_sand"),
        "5 %" if cell.spread else "exact",
        str(cell.drives),
    )


def _percent(value: float) -> str:
    return f"{100.0 * value:.1f}"


def _ground(cell: StreamCell) -> list[str]:
    both = (cell.cohesion, cell.tan_phi)
    errors = [f"{_percent(p.median_error)} / {_percent(p.p90_error)}" for p in both]
    covered = [
        f"{_percent(p.inside_95.share)} ({_percent(p.inside_95.low)} to"
        f" {_percent(p.inside_95.high)})"
        for p in both
    ]
    return [
        *errors,
        *covered,
        *(_percent(p.identified) for p in both),
        f"{100.0 * cell.refused:.2f}",
    ]


def _foretold(forecasts: Forecasts) -> tuple[str, ...]:
    return (
        _percent(forecasts.inside_95),
        _percent(forecasts.inside_68),
        f"{forecasts.spread:.2f}",
        f"{forecasts.calibration:.2f}",
    )


def _yes(cell: StreamCell) -> str:
    return "yes" if 0.93 <= cell.settled.inside_95 <= 0.97 else "**no**"
