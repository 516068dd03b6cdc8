# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of estimates: errors beside the Cramér-Rao bound, coverage with limits, consistency.

An episode ends at its first stuck second and keeps its last estimate, in the bound as well.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from scipy.stats import binomtest, chi2, norm
from torch import Tensor

from studies.batched import Trace
from studies.limited import Limited
from terrain_estimator.estimator.summary import IDENTIFIED_VARIANCE
from terrain_estimator.learning.departures import HIDDEN, Family, random_plant
from terrain_estimator.learning.tasks import (
    BENCHMARK,
    AboveZero,
    StrengthRange,
    Tasks,
    degrees,
    measure_tasks,
    random_ground,
)
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import STUCK_TIME, simulate
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

TIMES_S = (5.0, 10.0, 20.0, 40.0)
"""[s] Times at which estimates are judged; a drive lasts until the last."""
PARAMETERS = ("cohesion", "tan_phi")
ROWS = {"v": (1, 0, 0, 0), "v+L": (1, 1, 0, 0), "v+L+M": (1, 1, 1, 0), "v+L+M+B": (1, 1, 1, 1)}
"""Rows that an estimator gets: velocity, load, torques, moment balances; no accelerometer."""
CONFIDENCE = 0.99
"""[1] Of the limits of a coverage."""
HALF_NORMAL_MEDIAN = float(norm.ppf(0.75))
"""[standard deviations] median of |x|."""
_SETTLED_S = 5.0  # velocity predictions are judged from here on


PAPER_BAND = StrengthRange(((700.0, 1300.0),), (degrees(20.0, 45.0),))
"""The paper's test tasks (Banerjee et al., section V)."""
FROM_PRIOR = AboveZero(
    (DEFAULT_PRIOR.cohesion_pa, DEFAULT_PRIOR.tan_phi),
    (DEFAULT_PRIOR.cohesion_sd_pa, DEFAULT_PRIOR.tan_phi_sd),
)
"""The models' prior of c and tan phi."""


@dataclass(frozen=True, slots=True)
class MeasuredDrives:
    """Measured drives and where each ends."""

    tasks: Tasks  # without acceleration
    ends: Tensor  # [batch] observations before the first stuck second
    constants: Tensor  # [batch, 6] true soil constants


@dataclass(frozen=True, slots=True)
class ParameterScore:
    """One parameter; tuples are over times, errors relative to the truth."""

    median_error: tuple[float, ...]
    p90_error: tuple[float, ...]
    bound: tuple[float, ...]  # median error of an estimator that reaches the Cramer-Rao bound
    ratio_to_bound: tuple[float, ...]  # median of |error| / bound, 1 for an efficient estimator
    coverage_95: Limited  # at the last time, as what follows
    coverage_68: Limited
    identified: float  # share of episodes whose status is identified
    narrowest: float  # 1 % quantile of published deviation / bound


@dataclass(frozen=True, slots=True)
class CellScore:
    """One cell of the tables."""

    episodes: int
    stuck: float  # share of episodes that end early
    cohesion: ParameterScore
    tan_phi: ParameterScore
    # of the 95 % ellipse of (c, tan phi), whose narrow direction the marginals do not show
    joint_coverage_95: Limited
    nll: float  # mean negative log density of the true (c [kPa], tan phi) at the last time [nat]
    nis: float  # misfit of a block over its degrees of freedom, 1 for a consistent estimator
    nis_above_95: float  # share of blocks above the 95 % quantile of chi-square
    velocity_coverage_95: float  # of the one-step predictive interval
    velocity_spread: (
        float  # median over drives of the median predicted deviation, over that of the sensor [1]
    )
    velocity_calibration: (
        float  # rms predicted deviation over rms innovation, 1 for a consistent estimator
    )
    velocity_nll: float  # mean negative log predictive density of the velocity [nat]


def row_mask(rows: str, axles: int) -> Tensor:
    """The mask [A + 5] that belongs to a name in ROWS."""
    velocity, load, torque, moment = ROWS[rows]
    return torch.tensor(
        [velocity, load, *([torque] * axles), 0, moment, moment], dtype=torch.float64
    )


def draw_drives(
    rover: Rover,
    soil: Soil,
    schedule: str,
    episodes: int,
    spread: float,
    seed: int,
    truth: StrengthRange | AboveZero = BENCHMARK,
    hidden: Family | None = None,
    duration_s: float = TIMES_S[-1],
) -> MeasuredDrives:
    """Simulate and measure episodes of ``duration_s`` [s] with c and tan phi of ``truth``.

    Each soil constant is drawn within +-``spread`` [1] of the soil's, and each effect of the family
    ``hidden`` acts in a share HIDDEN of the episodes. The same seed gives the same drives.
    """
    generator = torch.Generator().manual_seed(seed)
    ground = random_ground(soil, episodes, generator, spread, truth)
    plant = random_plant(hidden, rover, episodes, HIDDEN, generator) if hidden else None
    drive = simulate(rover, ground, schedule, duration_s, generator, episodes, plant=plant)
    tasks = measure_tasks(drive, Noise(), generator)
    for packed in (tasks.measured, tasks.true):
        view_of(packed, rover.axles).acceleration.fill_(torch.nan)
    flagged = (~drive.sample.stuck).sum(1)
    struggling = round(STUCK_TIME / TIME_STEP) - 1
    ends = torch.where(drive.sample.stuck[:, -1], (flagged - struggling).clamp(min=0), flagged)
    return MeasuredDrives(tasks, ends, ground.patches[0].constants.expand(episodes, 6))


def observation_times(times_s: Sequence[float] = TIMES_S) -> Tensor:
    """Times [s] as indices of observations [K]."""
    return torch.tensor([round(time / TIME_STEP) - 1 for time in times_s])


class Judged(NamedTuple):
    """Results of N drives at K times; :func:`pool` joins those of several calls."""

    truth: Tensor  # [N, 2] c [Pa] and tan phi
    mean: Tensor  # [N, K, 2]
    covariance: Tensor  # [N, K, 2, 2]
    least: Tensor  # [N, K, 2] deviation of the Cramer-Rao bound
    prior_sd: Tensor  # [N, 2] of the model
    stuck: Tensor  # [N] 1 where the drive ended early
    blocks: Tensor  # [N, 4] sums over blocks: misfit, degrees of freedom, 1, misfits over 95 %
    # [N, 5] sums over predictions: 1, inside 95 %, twice the NLL, variance, squared innovation
    velocity: Tensor
    velocity_sd: Tensor  # [N] median predicted deviation [m/s], NaN where nothing was predicted


def judge(trace: Trace, drives: MeasuredDrives, bound: Tensor, prior_sd: Tensor) -> Judged:
    """Compare a trace with the truth at its K times.

    ``bound`` [N, K, 2, 2]; ``prior_sd`` [2] of the model.
    """
    counted = ~torch.isnan(trace.misfit) & (trace.degrees > 0)
    quantile = torch.from_numpy(chi2.ppf(0.95, trace.degrees.numpy()))
    blocks = [
        trace.misfit,
        trace.degrees,
        torch.ones_like(trace.misfit),
        (trace.misfit > quantile).double(),
    ]
    settled = slice(round(_SETTLED_S / TIME_STEP), None)
    innovation, variance = trace.innovation[:, settled], trace.variance[:, settled]
    scaled = innovation.square() / variance
    density = scaled + torch.log(2.0 * np.pi * variance)
    inside = (scaled < norm.ppf(0.975) ** 2).double()
    velocity = [torch.ones_like(variance), inside, density, variance, innovation.square()]
    return Judged(
        truth=drives.tasks.strength,
        mean=trace.mean,
        covariance=trace.covariance,
        least=_deviation(bound),
        prior_sd=prior_sd.expand_as(drives.tasks.strength),
        stuck=(drives.ends < trace.innovation.shape[1]).double(),
        blocks=torch.stack([torch.where(counted, value, 0.0).sum(1) for value in blocks], 1),
        velocity=torch.stack(
            [torch.where(torch.isnan(innovation), 0.0, value).sum(1) for value in velocity], 1
        ),
        velocity_sd=variance.sqrt().nanmedian(1).values,
    )


def pool(parts: Sequence[Judged]) -> Judged:
    """The drives of all parts."""
    return Judged(*(torch.cat(fields) for fields in zip(*parts, strict=True)))


def score(judged: Judged) -> CellScore:
    """The figures of these drives."""
    truth = judged.truth.unsqueeze(1)
    error = (judged.mean - truth).abs()
    sd = _deviation(judged.covariance)
    parameters = [
        _score_parameter(
            error[..., k], sd[..., k], judged.least[..., k], truth[..., k], judged.prior_sd[:, k]
        )
        for k in range(len(PARAMETERS))
    ]
    last = judged.mean[:, -1] - judged.truth, judged.covariance[:, -1]
    misfit, degrees, blocks, surprising = judged.blocks.sum(0).tolist()
    predictions, inside, density, variance, squared = judged.velocity.sum(0).tolist()
    return CellScore(
        episodes=truth.shape[0],
        stuck=float(judged.stuck.mean()),
        cohesion=parameters[0],
        tan_phi=parameters[1],
        joint_coverage_95=_joint_coverage(*last),
        nll=_nll(*last),
        nis=misfit / degrees,
        nis_above_95=surprising / blocks,
        velocity_coverage_95=inside / predictions,
        velocity_spread=float(judged.velocity_sd.nanmedian()) / Noise().velocity,
        velocity_calibration=math.sqrt(variance / squared),
        velocity_nll=0.5 * density / predictions,
    )


def _deviation(covariance: Tensor) -> Tensor:
    return covariance.diagonal(dim1=-2, dim2=-1).sqrt()


def _score_parameter(
    error: Tensor, sd: Tensor, least: Tensor, truth: Tensor, prior_sd: Tensor
) -> ParameterScore:
    """Return the score of one parameter.

    ``error``, published ``sd`` and bound ``least`` are [N, K], ``truth`` [N, 1], ``prior_sd`` [N].
    """
    relative = error / truth

    def over_time(values: Tensor, quantile: float = 0.5) -> tuple[float, ...]:
        return tuple(torch.quantile(values, quantile, dim=0).tolist())

    last, deviation = error[:, -1], sd[:, -1]
    return ParameterScore(
        median_error=over_time(relative),
        p90_error=over_time(relative, 0.9),
        bound=over_time(HALF_NORMAL_MEDIAN * least / truth),
        ratio_to_bound=over_time(error / least / HALF_NORMAL_MEDIAN),
        coverage_95=share_of(last < norm.ppf(0.975) * deviation),
        coverage_68=share_of(last < norm.ppf(0.84) * deviation),
        identified=float((deviation**2 <= IDENTIFIED_VARIANCE * prior_sd**2).double().mean()),
        narrowest=float(torch.quantile(deviation / least[:, -1], 0.01)),
    )


def share_of(flags: Tensor) -> Limited:
    """The share of ``flags`` [N] with its confidence limits (Clopper and Pearson)."""
    limits = binomtest(int(flags.sum()), flags.shape[0]).proportion_ci(CONFIDENCE)
    return Limited(float(flags.double().mean()), float(limits.low), float(limits.high))


def _joint_coverage(error: Tensor, covariance: Tensor) -> Limited:
    distance = (error * torch.linalg.solve(covariance, error.unsqueeze(-1)).squeeze(-1)).sum(-1)
    return share_of(distance < chi2.ppf(0.95, 2))


def _nll(error: Tensor, covariance: Tensor) -> float:
    unit = torch.tensor([1000.0, 1.0], dtype=torch.float64)
    scaled = covariance / unit / unit.unsqueeze(-1)
    density = torch.distributions.MultivariateNormal(torch.zeros(2, dtype=torch.float64), scaled)
    return float(-density.log_prob(error / unit).mean())  # type: ignore[no-untyped-call]
