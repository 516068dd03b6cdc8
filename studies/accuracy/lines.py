# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of the accuracy tables: cells, with figures of single drives."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from scipy.stats import norm
from torch import Tensor

from studies.accuracy.cells import AccuracyCell, CellBatch, Setting, cells
from studies.accuracy.scores import Judged, pool, share_of
from studies.limited import Limited
from terrain_estimator.estimator.summary import IDENTIFIED_VARIANCE


@dataclass(frozen=True, slots=True)
class Claim:
    """Claims of the published intervals of one parameter after a cell's time."""

    least: float  # smallest published deviation of any drive, over its bound [1]
    unfounded: float  # share of drives with status identified that the bound does not identify [1]
    covered: (
        Limited | None
    )  # by the 95 % interval, of drives with status identified; None without any


@dataclass(frozen=True, slots=True)
class TableLine(AccuracyCell):
    """One line of the tables."""

    cohesion: Claim
    tan_phi: Claim


def lines(setting: Setting, parts: Sequence[CellBatch]) -> list[TableLine]:
    """The lines that all parts of a setting give together."""
    found = []
    for cell in cells(setting, parts):
        judged = pool(
            [
                part.judged[cell.rows, cell.model]
                for part in parts
                if (cell.rows, cell.model) in part.judged
            ]
        )
        place = (
            cell.rover,
            cell.soil,
            cell.schedule,
            cell.spread,
            cell.truth,
            cell.rows,
            cell.model,
        )
        found.append(TableLine(*place, cell.score, _claim(judged, 0), _claim(judged, 1)))
    return found


def _claim(judged: Judged, parameter: int) -> Claim:
    deviation, bound = (
        judged.covariance[:, -1, parameter, parameter].sqrt(),
        judged.least[:, -1, parameter],
    )
    inside = (judged.mean[:, -1, parameter] - judged.truth[:, parameter]).abs() < norm.ppf(
        0.975
    ) * deviation
    identified, could_be = (
        _identified(value, judged.prior_sd[:, parameter]) for value in (deviation, bound)
    )
    return Claim(
        least=float((deviation / bound).min()),
        unfounded=float((identified & ~could_be).double().mean()),
        covered=share_of(inside[identified]) if bool(identified.any()) else None,
    )


def _identified(deviation: Tensor, prior_sd: Tensor) -> Tensor:
    return torch.le(deviation**2, IDENTIFIED_VARIANCE * prior_sd**2)
