# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The size of what drives show, as a rover engineer asks for it: how much more does a wheel pull?

The change of one wheel's sinkage, drawbar pull and torque at slip SLIP and the mean load of the
rover's wheels, with an effect over without it, on the soil of the first run. c and tan phi are the
means over runs, the wheel rate [rad/s] is the median. Of a law of the soil another author's may be
the true one: the change counts this by the same share as the size does.
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
from terramechanics.contact.sinkage import DEEPEST
from terramechanics.effects.simulated import SimulatedEffect
from terramechanics.terrain.soil import WONG_REECE

SHOWN = ("bulldozing", "grousers", "slip_sinkage", "rate_dependence", "exit_angle")
"""Effects of the contact that one wheel on fresh ground shows."""
_ROWS = ("sinkage", "drawbar_pull", "torque")
_DRAWS = 200
_DROWNS = 0.999
"""[1] Share of the deepest sinkage of the search from which the ground does not carry the wheel."""


def wheel_changes(
    candidate: Candidate, nominal: Nominal, runs: Sequence[Blocks], seed: int = 0
) -> list[Change | None]:
    """Return what each effect of a candidate changes, alone.

    ``nominal`` is on the soils of the fit, ``seed`` that of draws from its posterior. None for
    effects that are not SHOWN, on a soil of another contact law than Wong and Reece's, and where
    the ground does not carry the wheel.
    """
    soil = nominal.soil_of(runs[0].soil or nominal.soil)
    if soil.law != WONG_REECE:
        return [None for _ in candidate.hypothesis.effects]
    rig = Rig(nominal.rover, soil, (), ())
    rate = float(torch.cat([run.wheel_rate.flatten() for run in runs]).abs().median())
    theta = torch.stack([run.theta for run in candidate.fit.point.runs]).mean(0)
    strength = theta * torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
    generator = np.random.default_rng(seed)
    found: list[Change | None] = []
    first = len(candidate.hypothesis.doubt)
    for effect in candidate.hypothesis.effects:
        here = slice(first, first + effect.count)
        first += effect.count
        if effect.name not in SHOWN:
            found.append(None)
            continue
        acting = effect.with_values(_values(candidate, effect, here, generator))
        found.append(_change(rig, strength, rate, acting))
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


def _change(rig: Rig, strength: Tensor, rate: float, acting: SimulatedEffect) -> Change | None:
    """Return the change by _DRAWS sizes of an effect.

    ``strength`` [2] is c [Pa] and tan phi, ``rate`` the wheel's [rad/s].
    """
    rover, constants = rig.rover, rig.soil.constants()
    load = rover.weight / len(rover.wheels)
    cells = cells_of([Row("", "", SLIP, load, rate, 0.0, 0.0)])

    def states(effects: Sequence[SimulatedEffect], count: int) -> Tensor:
        several = strength.expand(count, -1), constants.expand(count, -1)
        return rig.states(cells, *several, effects)[:, 0]

    without, with_it = states([], 1), states([acting], _DRAWS)
    deepest = torch.cat([without, with_it])[:, ROWS.index("sinkage")].max()
    if float(deepest) > _DROWNS * DEEPEST * rover.wheel_radius:
        return None
    low, middle, high = np.quantile((with_it - without).numpy(), ENDS, 0).tolist()
    places = {row: ROWS.index(row) for row in _ROWS}
    return Change(SLIP, load, {row: (low[k], middle[k], high[k]) for row, k in places.items()})
