# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of a method: quartiles over drives, means, and shares."""

import torch
from torch import Tensor

from studies.baselines.drives import LevelDrives
from studies.baselines.interface import Estimates
from terramechanics.simulation.sample import TIME_STEP

TIMES_S = (5.0, 10.0, 20.0, 40.0)
"""[s] Times at which estimates are compared."""
Scores = dict[str, float | list[float] | dict[str, list[float]] | None]
"""Ready for JSON."""


def quartiles(values: Tensor) -> list[float]:
    """Return the 25 %, 50 % and 75 % quantiles of [drives]."""
    levels = torch.tensor([0.25, 0.5, 0.75], dtype=torch.float64)
    return [float(value) for value in torch.quantile(values, levels)]


def relative_errors(parameters: Tensor, drives: LevelDrives) -> Tensor:
    """Return |error| of c, tan phi and phi in percent of the truth, [drives, time, 3]."""
    truth, estimate = _with_angle(drives.strength.unsqueeze(1)), _with_angle(parameters)
    return 100.0 * ((estimate - truth) / truth).abs()


def _with_angle(parameters: Tensor) -> Tensor:
    """Append phi to c and tan phi: [..., 3]."""
    return torch.cat([parameters, torch.atan(parameters[..., 1:])], -1)


def score(estimates: Estimates, drives: LevelDrives) -> Scores:
    """Return all scores of one method on one set of drives."""
    scores: Scores = {}
    if estimates.parameters is not None:
        scores |= _parameter_scores(estimates.parameters, estimates.deviation, drives)
    if estimates.velocity is not None:
        scores |= _velocity_scores(estimates.velocity, estimates.velocity_sd, drives)
    return scores


def _parameter_scores(parameters: Tensor, deviation: Tensor | None, drives: LevelDrives) -> Scores:
    errors = relative_errors(parameters, drives)
    index = {
        f"{time:g}": round(time / TIME_STEP) - 1
        for time in TIMES_S
        if round(time / TIME_STEP) <= errors.shape[1]
    }
    scores: Scores = {}
    for column, name in enumerate(("cohesion", "tan_phi", "angle")):
        scores[f"{name}_error_percent"] = {
            time: quartiles(errors[:, place, column]) for time, place in index.items()
        }
        scores[f"{name}_mean_error_percent"] = float(errors[:, -1, column].mean())
    truth, estimate = _with_angle(drives.strength.unsqueeze(1)), _with_angle(parameters)
    signed = 100.0 * ((estimate - truth) / truth).mean(1).abs()
    # As the authors' code computes its figure: signed errors averaged over the drive before their
    # size is taken.
    scores["error_as_in_the_figure_percent"] = quartiles(0.5 * (signed[:, 0] + signed[:, 2]))
    scores["error_percent"] = quartiles(0.5 * (errors[:, -1, 0] + errors[:, -1, 2]))
    if deviation is not None:
        inside = (parameters[:, -1] - drives.strength).abs() <= 1.96 * deviation[:, -1]
        scores["coverage"] = [float(share) for share in inside.double().mean(0)]
    return scores


def _velocity_scores(velocity: Tensor, velocity_sd: Tensor | None, drives: LevelDrives) -> Scores:
    true = drives.true_velocity[:, 1:]
    error = velocity - true
    settled = slice(min(50, error.shape[1] // 2), None)
    scores: Scores = {
        "velocity_rms_mm_s": quartiles(1e3 * error[:, settled].square().mean(1).sqrt()),
        "velocity_error_percent": quartiles(
            100.0 * error[:, settled].abs().mean(1) / true[:, settled].abs().mean(1)
        ),
        "velocity_bias_mm_s": quartiles(1e3 * error[:, settled].mean(1).abs()),
    }
    if velocity_sd is not None:
        miss = (velocity - drives.velocity[:, 1:])[:, settled]
        scores["velocity_coverage"] = float(
            (miss.abs() <= 1.96 * velocity_sd[:, settled]).double().mean()
        )
        scores["velocity_spread_mm_s"] = float(1e3 * velocity_sd[:, settled].mean())
    return scores
