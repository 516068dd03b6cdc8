# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Predictions against measurements: errors, likelihood and coverage, by row and by region."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.runs import Blocks

INTERVAL = 1.959963984540054
"""[standard deviations] Half width of a 95 % interval."""
LEVEL = math.radians(1.5)
"""[rad] Pitch below which ground counts as level."""


@dataclass(frozen=True, slots=True)
class Predicted:
    """Measured less predicted at N moments of R rows, with the model's deviation of it.

    NaN where a row is not there.
    """

    error: Tensor  # [N, R] in the units of the rows
    sd: Tensor  # [N, R]
    misfit: Tensor  # [N] sum of the squared errors of the rows that are there, in units of a noise
    expected: Tensor  # [N] what the model expects of the misfit
    count: Tensor  # [N] rows that are there
    surprise: Tensor  # [N] [nat] negative log likelihood of those rows together


def joined(parts: Sequence[Predicted]) -> Predicted:
    """Return several predictions as one."""
    return Predicted(
        *(torch.cat([getattr(part, name) for part in parts]) for name in Predicted.__slots__)
    )


@dataclass(frozen=True, slots=True)
class RowScore:
    """Scores of one row in one region, before and after; None where nothing is added."""

    kind: str  # one_step or rollout
    row: str
    region: str
    unit: str
    count: int
    noise_floor: float  # [unit] root mean square error that the better model expects of itself
    error: tuple[float, float | None]  # [unit] root mean square, before and after
    nll: tuple[float, float | None]  # [nat] of one value, mean
    coverage: tuple[float, float | None]  # [1] share of the values inside of their 95 % intervals


def scores(
    kind: str,
    rows: Sequence[tuple[str, str]],
    regions: Mapping[str, Tensor],
    before: Predicted,
    after: Predicted | None,
) -> list[RowScore]:
    """Score every row (name, unit) in every region ([N] bool), then all rows together.

    Regions without a value are left out.
    """
    found = []
    for region, here in regions.items():
        there = here & (before.count > 0.0)
        if bool(there.any()):
            first, second = (
                _together(before, there),
                None if after is None else _together(after, there),
            )
            found.append(
                _score(
                    kind,
                    ("all rows", "standard deviations"),
                    region,
                    int(before.count[there].sum()),
                    first,
                    second,
                )
            )
    for k, (row, unit) in enumerate(rows):
        for region, here in regions.items():
            there = here & torch.isfinite(before.error[:, k])
            if after is not None:
                there = there & torch.isfinite(after.error[:, k])
            if bool(there.any()):
                second = None if after is None else _of(after, k, there)
                found.append(
                    _score(
                        kind, (row, unit), region, int(there.sum()), _of(before, k, there), second
                    )
                )
    return found


_Numbers = tuple[
    float, float, float, float
]  # error, negative log likelihood, coverage, and the error that is expected


def _score(
    kind: str,
    row: tuple[str, str],
    region: str,
    count: int,
    before: _Numbers,
    after: _Numbers | None,
) -> RowScore:
    error, nll, coverage = ((before[i], None if after is None else after[i]) for i in range(3))
    return RowScore(kind, row[0], region, row[1], count, (after or before)[3], error, nll, coverage)


def _together(predicted: Predicted, there: Tensor) -> _Numbers:
    count = predicted.count[there].sum()
    standardized = (predicted.error / predicted.sd)[there]
    error, expected = (
        (values[there].sum() / count).sqrt() for values in (predicted.misfit, predicted.expected)
    )
    inside = (standardized.abs() < INTERVAL).sum() / torch.isfinite(standardized).sum()
    return (
        float(error),
        float(predicted.surprise[there].sum() / count),
        float(inside),
        float(expected),
    )


def _of(predicted: Predicted, row: int, there: Tensor) -> _Numbers:
    error, sd = predicted.error[there, row], predicted.sd[there, row]
    standardized = error / sd
    nll = (0.5 * (standardized.square() + math.log(2.0 * math.pi)) + sd.log()).mean()
    return (
        rms(error),
        float(nll),
        float((standardized.abs() < INTERVAL).to(error.dtype).mean()),
        rms(sd),
    )


def rms(values: Tensor) -> float:
    """Return the root mean square."""
    return float(values.square().mean().sqrt())


def regions_of(runs: Sequence[Blocks]) -> list[dict[str, Tensor]]:
    """Return the regions of each block of some runs, [B] bool by name.

    By slope, speed, slip and time.

    By the signals of the neighbouring seconds, as that of a second itself has its noise in common
    with the second's rows.
    """
    speed, slip = (torch.cat([signal(run) for run in runs]).median() for signal in (_speed, _slip))
    return [_regions(run, float(speed), float(slip)) for run in runs]


def _speed(run: Blocks) -> Tensor:
    return run.signals.speed.mean(1)


def _slip(run: Blocks) -> Tensor:
    return run.signals.slip.mean(1)


def _regions(run: Blocks, speed: float, slip: float) -> dict[str, Tensor]:
    pitch, time = run.signals.pitch[:, 0], run.signals.time[:, 0]
    third = (time / (time[-1] / 3.0)).floor().clamp(max=2.0)
    return {
        "everywhere": torch.ones_like(pitch, dtype=torch.bool),
        "uphill": pitch > LEVEL,
        "level": pitch.abs() <= LEVEL,
        "downhill": pitch < -LEVEL,
        "slow half": _speed(run) < speed,
        "fast half": _speed(run) >= speed,
        "little slip": _slip(run) < slip,
        "much slip": _slip(run) >= slip,
        "first third": third == 0.0,
        "middle third": third == 1.0,
        "last third": third == 2.0,
    }
