# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The size of what drives show, as a rover engineer asks for it: how much more does a wheel pull?

The change of one wheel's sinkage, drawbar pull and torque at slip SLIP and the mean load of the
rover's wheels, with an effect over without it. Soil, c, tan phi and wheel rate are those of the
runs in the mean. Of a law of the soil another author's may be the true one: the change counts this
by the same share as the size does.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.study import Candidate
from terrain_estimator.discovery.hypotheses.library import OTHER_SOIL_LAW, LibraryEffect
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.discovery.single_wheel.cells import ROWS, Rig, Row, cells_of
from terrain_estimator.discovery.single_wheel.size import ENDS, SLIP, Change
from terrain_estimator.model.rows import PA_PER_UNIT
from terramechanics.simulation.plant import Effect
from terramechanics.terrain.soil import WONG_REECE

SHOWN = ("bulldozing", "grousers", "slip_sinkage", "rate_dependence", "exit_angle")
"""Effects of the contact that one wheel on fresh ground shows."""
_ROWS = ("sinkage", "drawbar_pull", "torque")
_DRAWS = 200


def wheel_changes(
    candidate: Candidate, nominal: Nominal, runs: Sequence[Blocks], seed: int = 0
) -> list[Change | None]:
    """Return what each effect of a candidate changes, alone.

    None for effects that are not SHOWN, on a soil of another contact law than Wong and Reece's, and
    where the wheel finds no equilibrium.
    """
    if nominal.soil.law != WONG_REECE:
        return [None for _ in candidate.hypothesis.effects]
    generator, found = np.random.default_rng(seed), []
    first = len(candidate.hypothesis.doubt)
    for effect in candidate.hypothesis.effects:
        here = slice(first, first + effect.count)
        first += effect.count
        drawn = _values(candidate, effect, here, generator) if effect.name in SHOWN else None
        found.append(None if drawn is None else _change(candidate, nominal, runs, effect, drawn))
    return found


def _values(
    candidate: Candidate, effect: LibraryEffect, here: slice, generator: np.random.Generator
) -> Tensor:
    """Return draws [_DRAWS, V] of the values of an effect, in their ranges."""
    fit, ranges = candidate.fit, candidate.hypothesis.shared()
    mean, covariance = fit.point.shared[here], fit.covariance[here, here]
    drawn = torch.from_numpy(
        generator.multivariate_normal(mean.numpy(), covariance.numpy(), _DRAWS)
    )
    other_law = 1.0 + OTHER_SOIL_LAW * generator.standard_normal(_DRAWS).clip(-3.0, 3.0)
    sizes = [
        effect.law.value_of(float(share) * effect.law.size_of(float(value)))
        for share, value in zip(other_law, drawn[:, 0], strict=True)
    ]
    drawn[:, 0] = torch.tensor(sizes, dtype=torch.float64)
    return torch.clamp(drawn, ranges.low[here], ranges.high[here])


def _change(
    candidate: Candidate,
    nominal: Nominal,
    runs: Sequence[Blocks],
    effect: LibraryEffect,
    values: Tensor,
) -> Change | None:
    rover = nominal.rover
    load = rover.weight / len(rover.wheels)
    rate = float(torch.cat([run.wheel_rate.flatten() for run in runs]).abs().median())
    cells = cells_of([Row("", "", SLIP, load, rate, 0.0, 0.0)])
    soil = nominal.soil_of(runs[0].soil or nominal.soil)
    rig = Rig(rover, soil, (), ())
    theta = torch.stack([run.theta for run in candidate.fit.point.runs]).mean(0)
    strength = theta * torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)

    def state(effects: Sequence[Effect], count: int) -> Tensor:
        of = strength.expand(count, 2), soil.constants().expand(count, -1)
        return rig.states(cells, *of, effects)[:, 0]

    changed = state([effect.with_values(values)], len(values)) - state([], 1)
    if not bool(torch.isfinite(changed).all()):
        return None
    low, middle, high = np.quantile(changed.numpy(), ENDS, 0).tolist()
    places = {row: ROWS.index(row) for row in _ROWS}
    return Change(SLIP, load, {row: (low[k], middle[k], high[k]) for row, k in places.items()})
