# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of models with and without the net, on plants with and without hidden effects."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from scipy.stats import norm
from torch import Tensor

from studies.accuracy.scores import (
    CONFIDENCE,
    CellScore,
    MeasuredDrives,
    draw_drives,
    judge,
    observation_times,
    row_mask,
    score,
)
from studies.batched import Trace, run
from studies.limited import Limited
from terrain_estimator.learning.departures import Family
from terrain_estimator.model.palpaca import PAlpaca
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

PLANTS: dict[str, Family | None] = {
    "no hidden effect": None,
    "effects as in training": Family.LEARNT,
    "other effects": Family.FOREIGN,
}
SPREAD = 0.05
"""[1] Largest relative error of each soil constant."""
ROWS = "v+L+M+B"
_SETTLED = 50  # observations before velocity predictions are judged


@dataclass(frozen=True, slots=True)
class NetCandidate:
    """A model with the net, beside physics alone on the same drives."""

    score: CellScore
    # of the one-step velocity predictive, with the net less without; a mean over drives [nat]
    nll_change: Limited


@dataclass(frozen=True, slots=True)
class Comparison:
    """Physics alone and with the net on one plant."""

    plant: str
    physics: CellScore
    with_net: dict[str, NetCandidate]


def compare(
    rover: Rover,
    soil: Soil,
    physics: PAlpaca,
    candidates: Mapping[str, PAlpaca],
    plant: str,
    episodes: int,
    seed: int,
) -> Comparison:
    """Compare all models on ``episodes`` drives of 40 s with constants 5 % wrong.

    ``seed`` must not be that of a training.
    """
    drives = draw_drives(rover, soil, "S1", episodes, SPREAD, seed, hidden=PLANTS[plant])
    alone = _trace(physics, drives)
    found = {}
    for name, model in candidates.items():
        trace = _trace(model, drives)
        found[name] = NetCandidate(
            _score(model, trace, drives), limits(velocity_nll(trace) - velocity_nll(alone))
        )
    return Comparison(plant, _score(physics, alone, drives), found)


def limits(values: Tensor) -> Limited:
    """Return the mean of ``values`` [N] that are not NaN, with its limits at CONFIDENCE."""
    values = values[~torch.isnan(values)]
    mean, error = float(values.mean()), float(values.std() / values.shape[0] ** 0.5)
    reach = float(norm.ppf(0.5 + 0.5 * CONFIDENCE)) * error
    return Limited(mean, mean - reach, mean + reach)


def velocity_nll(trace: Trace) -> Tensor:
    """Return the mean negative log density [nat] of each drive's velocities [N], one step ahead."""
    innovation, variance = trace.innovation[:, _SETTLED:], trace.variance[:, _SETTLED:]
    return (0.5 * (innovation.square() / variance + torch.log(2.0 * torch.pi * variance))).nanmean(
        1
    )


def _trace(model: PAlpaca, drives: MeasuredDrives) -> Trace:
    return run(
        model, drives.tasks.measured, observation_times(), drives.ends, row_mask(ROWS, model.axles)
    )


def _score(model: PAlpaca, trace: Trace, drives: MeasuredDrives) -> CellScore:
    unknown = torch.full(
        (*trace.mean.shape, 2), torch.nan, dtype=torch.float64
    )  # the bound of a plant with hidden effects
    return score(judge(trace, drives, unknown, model.hypotheses.prior_sd))
