# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One batch of drives, estimated by the model that ships and by the lifted statistic."""

import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from studies import batched
from studies.accuracy.cells import EVERY_ROW, WRONG
from studies.accuracy.scores import (
    FROM_PRIOR,
    MeasuredDrives,
    draw_drives,
    observation_times,
    row_mask,
)
from studies.bound import Known, cramer_rao_at
from studies.recursion.drive import RecursionVariant, block_mask, prior_of, run
from studies.recursion.quadrature import integrate
from studies.recursion.readout import PriorOf, read_out
from studies.recursion.statistic import Statistic
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.model.palpaca import PAlpaca
from terramechanics.presets import load_rover, load_soil

ROVERS, SOIL = ("paper_rover", "mars_rover"), "loose_sand"
ROW_SETS = ("v+L", EVERY_ROW)
SHIPPED = "as it ships"
INSTRUMENTS = {"columns": 0.0, "corrected columns": 1.0}
"""The instruments Z, and whether they are corrected by the residual."""
GRID = "grid"
READ_OUTS = {
    "sandwich": "scores",
    "Gaussian": "combined",
    GRID: "combined",
    "every score": "moments",
}
"""The read-outs, and what of readout.WAYS they begin with."""

Record = dict[str, NDArray[np.float64]]


class Result(NamedTuple):
    """The estimates of N drives at K times."""

    mean: Tensor  # [N, K, 2] c [Pa], tan phi
    covariance: Tensor  # [N, K, 2, 2]
    clamped: Tensor  # [N, K] share of the information left out


def methods() -> list[str]:
    """Return the names of everything that is compared."""
    lifted = [f"{z}, {read_out}" for z in INSTRUMENTS for read_out in READ_OUTS]
    return [SHIPPED, *lifted]


def study(name: str, drives: int, times_s: tuple[float, ...], seed: int) -> Record:
    """Draw drives of a rover and return the truth, the bounds and every method's estimates.

    The keys are "truth" [N, 2], "ends" [N] [s] and "ROWS|METHOD|FIELD" as in Result, with "bound"
    for a method of which only the deviation "least" [N, K, 2] is kept.
    """
    rover, soil = load_rover(name), load_soil(SOIL)
    drawn = draw_drives(rover, soil, "S1", drives, WRONG, seed, FROM_PRIOR, duration_s=times_s[-1])
    model = physics_alone(rover, soil, exact=False)
    record = {"truth": drawn.tasks.strength.numpy(), "ends": 0.1 * drawn.ends.double().numpy()}
    bounds = _bounds(model, drawn, times_s)
    found = _lifted(model, drawn, times_s)
    for place, rows in enumerate(ROW_SETS):
        record[f"{rows}|bound|least"] = bounds[place].numpy()
        found[rows, SHIPPED] = _shipped(model, drawn, rows, times_s)
    for (rows, method), result in found.items():
        for field, values in result._asdict().items():
            record[f"{rows}|{method}|{field}"] = values.numpy()
    return record


def _bounds(model: PAlpaca, drawn: MeasuredDrives, times_s: tuple[float, ...]) -> Tensor:
    """Return the deviations [S, N, K, 2] of the Cramer-Rao bound with each set of rows."""
    sets = torch.stack([row_mask(rows, model.axles) for rows in ROW_SETS])
    known = Known(sets, drawn.ends, drawn.constants, WRONG / math.sqrt(3.0))
    bound = cramer_rao_at(model, drawn.tasks, observation_times(times_s), known)
    return bound.diagonal(dim1=-2, dim2=-1).sqrt()


def _shipped(
    model: PAlpaca, drawn: MeasuredDrives, rows: str, times_s: tuple[float, ...]
) -> Result:
    mask, times = row_mask(rows, model.axles), observation_times(times_s)
    trace = batched.run(model, drawn.tasks.measured, times, drawn.ends, mask)
    return Result(trace.mean, trace.covariance, torch.zeros_like(trace.mean[..., 0]))


def _lifted(
    model: PAlpaca, drawn: MeasuredDrives, times_s: tuple[float, ...]
) -> dict[tuple[str, str], Result]:
    prior, unit = prior_of(model), model.hypotheses.unit
    names = [(rows, z) for rows in ROW_SETS for z in INSTRUMENTS]
    variants = [
        RecursionVariant(block_mask(row_mask(rows, model.axles)), INSTRUMENTS[z])
        for rows, z in names
    ]
    blocks = [round(time) for time in times_s]
    statistics = run(model, drawn.tasks.measured, drawn.ends, variants, blocks)
    found = {}
    for (rows, z), at_times in zip(names, statistics, strict=True):
        for way in READ_OUTS:
            parts = [_read(statistic, prior, way, unit) for statistic in at_times]
            found[rows, f"{z}, {way}"] = Result(
                *(torch.stack(fields, 1) for fields in zip(*parts, strict=True))
            )
    return found


def _read(statistic: Statistic, prior: PriorOf, way: str, unit: Tensor) -> Result:
    """Return the estimates at one time, without the dimension of times."""
    estimate = read_out(statistic, prior, READ_OUTS[way])
    mean, covariance = estimate.k[:, :2], estimate.covariance[:, :2, :2]
    if way == GRID:
        mean, covariance, _ = integrate(statistic, estimate, prior)
    return Result(mean * unit, covariance * unit * unit.unsqueeze(1), estimate.clamped)
