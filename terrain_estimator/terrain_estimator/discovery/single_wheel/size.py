# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The size of what is named, as a rover engineer asks for it: how much more does the wheel pull?

The change of every row at slip SLIP and the middle load of the tables, with the effect over
without it on the same soil. Laws of a family are averaged by their evidence; each contributes
draws from its Gaussian posterior, and the model error that stands beside it.
"""

from dataclasses import dataclass

import numpy as np
import torch

from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.single_wheel.cells import ROWS, Cells, Rig
from terrain_estimator.discovery.single_wheel.families import Family
from terrain_estimator.discovery.single_wheel.fit import Explained, Floats, WheelModel

SLIP = 0.3
"""[1] Slip at which changes are reported."""
ENDS = (0.025, 0.5, 0.975)
"""[1] Shares below the ends and the middle of a 95 % interval."""
_DRAWS = 300


@dataclass(frozen=True, slots=True)
class Change:
    """95 % intervals of the change of each measured row: lower end, median, upper end."""

    slip: float  # [1]
    load: float  # [N]
    rows: dict[str, tuple[float, float, float]]  # by row, in UNITS


def change(bed: Rig, cells: Cells, given: Hypothesis, family: Family, seed: int = 0) -> Change:
    """Return what a family changes; ``given`` effects act with and without it."""
    generator = np.random.default_rng(seed)
    acting = [k for k in range(len(cells.slip)) if bool(cells.acts[k])]
    load = float(cells.load[acting].median())
    both = _both(cells.part(acting), load)
    drawn = np.concatenate(
        [
            _drawn(WheelModel(bed, given, law.hypothesis), both, law, count, generator)
            for law, count in zip(family.laws, _shares(family), strict=True)
            if count
        ]
    )
    seen = [k for k, any_seen in enumerate(cells.seen.any(0).tolist()) if any_seen]
    low, middle, high = np.quantile(drawn, ENDS, 0).tolist()
    return Change(SLIP, load, {ROWS[k]: (low[k], middle[k], high[k]) for k in seen})


def _shares(family: Family) -> list[int]:
    """Return the number of draws of each law."""
    return [round(_DRAWS * weight) for weight in family.weights]


def _both(cells: Cells, load: float) -> Cells:
    """Return one setting twice: where the effect acts, and where it does not."""
    one = torch.ones(2, dtype=torch.float64)
    speed = float((cells.wheel_rate * (1.0 - cells.slip)).median())
    return Cells(
        (cells.table[0], ""),
        SLIP * one,
        load * one,
        speed / (1.0 - SLIP) * one,
        0.0 * one,
        torch.full((2, len(ROWS)), torch.nan, dtype=torch.float64),
        (1, 1),
        torch.tensor([True, False]),
    )


def _drawn(
    model: WheelModel, both: Cells, law: Explained, count: int, generator: np.random.Generator
) -> Floats:
    """Return changes [count, R]."""
    values = generator.multivariate_normal(law.values, law.covariance, count)
    found = []
    for each in values.clip(model.low, model.high):
        with_it, without = model.of(both, each)
        found.append(with_it - without)
    return np.array(found) + law.model_error * generator.standard_normal((count, len(ROWS)))
