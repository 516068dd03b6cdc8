# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rollouts against measurements, as means over each second, with the expected difference."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.proof.scores import Predicted
from terrain_estimator.discovery.runs import PIECE
from terrain_estimator.model.packed_observation import BLOCK
from terrain_estimator.model.packing import view_of


@dataclass(frozen=True, slots=True)
class MeasuredSignals:
    """R signals of windows of T observations, all but the first of each."""

    values: Tensor  # [W, T - 1, R]
    sd: Tensor  # [W, T - 1, R] of the sensors


def names(axles: int) -> tuple[tuple[str, str], ...]:
    """Return the signals and their units."""
    wheels = (("slip", "1"), ("sinkage", "m"), ("torque", "N m"))
    return (
        ("velocity", "m/s"),
        *((f"{name}_{k}", unit) for name, unit in wheels for k in range(axles)),
    )


def measured(packed: Tensor, axles: int) -> MeasuredSignals:
    """Return the signals of packed observations [W, T - 1, P] in the order of ``names``."""
    view = view_of(packed, axles)
    deviations = [view.velocity_sd.unsqueeze(-1), view.slip_sd, view.sinkage_sd, view.torque_sd]
    return MeasuredSignals(
        torch.cat([view.velocity.unsqueeze(-1), view.slip, view.sinkage, view.torque], -1),
        torch.cat(deviations, -1),
    )


def compared(seen: MeasuredSignals, base: Tensor, changes: Tensor, by_terrain: Tensor) -> Predicted:
    """Return the errors of all seconds of all windows [W PIECE, R].

    Arguments as in ``rollout.SimulatedSignals``.

    ``misfit`` is in units of the sensors' noise alone, which no model can talk up; what a model is
    not sure of is in ``expected``.
    """
    error, sensor = _means(seen.values - base), _means(seen.sd.square(), 1).sqrt()
    terrain = _means(by_terrain).square().mean([0, 1, 2]).expand_as(error)
    unknown = _means(changes).square().sum(0) + terrain
    error, sensor, unknown = (
        values.reshape(-1, values.shape[-1]) for values in (error, sensor, unknown)
    )
    sd = (sensor.square() + unknown).sqrt()
    there = torch.isfinite(error / sd)

    def total(values: Tensor) -> Tensor:
        return torch.where(there, values, 0.0).sum(1)

    return Predicted(
        error=torch.where(there, error, math.nan),
        sd=torch.where(there, sd, math.nan),
        misfit=total((error / sensor).square()),
        expected=total((sd / sensor).square()),
        count=there.sum(1).to(error.dtype),
        surprise=total(0.5 * ((error / sd).square() + math.log(2.0 * math.pi)) + sd.log()),
    )


def _means(values: Tensor, power: int = 0) -> Tensor:
    """Return means over each second, [..., W, T - 1, R] to [..., W, PIECE, R].

    With ``power`` 1 the variances of means.
    """
    first = torch.full_like(values[..., :1, :], math.nan)
    seconds = torch.cat([first, values], -2).reshape(
        *values.shape[:-2], PIECE, BLOCK, values.shape[-1]
    )
    there = torch.isfinite(seconds)
    count = there.sum(-2)
    mean = torch.where(there, seconds, 0.0).sum(-2) / count.clamp(min=1) ** (1 + power)
    return torch.where(count > BLOCK // 2, mean, math.nan)
