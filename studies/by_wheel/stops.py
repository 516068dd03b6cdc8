# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the planner says of a skid-steer's turns, beside how much its outer wheels slip."""

import dataclasses
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from studies.by_wheel.drives import SEED, model_by_wheel
from studies.by_wheel.motions import CONSTANTS_OFF
from studies.off_plane import DRIVES, KINDS, SAMPLES, SOIL, first_stop, simulated
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.observation import AXLE_FIELDS, Observation
from terrain_estimator.planning.planner import Reason
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.table import TractionTable
from terramechanics.presets import load_rover
from terramechanics.vehicle.wheel_places import WheelPlaces, chassis_places, wheel_order

YAW_RATES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""[rad/s] Commanded."""
WINDOW = 20
"""Steps over which a slip is averaged, as the planner averages its measurements."""
STOP_HEAD = (
    "commanded",
    "largest slip of the outer wheels, median / highest of the drives",
    "margins known",
    "drives with more than 0.6: stopped by TRACTION",
    "the others: stopped by TRACTION",
    "for other reasons",
)


def by_axle(observation: Observation, order: Sequence[int]) -> Observation:
    """Return an observation with the means of each axle's wheels, as the planner takes it.

    ``order`` tells the axle of each wheel.
    """
    axles = np.array(order)
    means: dict[str, Any] = {
        name: np.array([getattr(observation, name)[axles == each].mean() for each in set(order)])
        for name in AXLE_FIELDS
    }
    return dataclasses.replace(observation, **means, steering=None)


def stop_lines(
    drives: int = DRIVES, samples: int = SAMPLES, yaw_rates: Sequence[float] = YAW_RATES
) -> Iterator[tuple[str, ...]]:
    """Yield the lines of the skid-steer's table, one for each commanded yaw rate."""
    kind = KINDS[0]
    rover, places = load_rover(kind.rover), WheelPlaces(kind.track, kind.yaw_inertia)
    order = [chassis_places(rover)[k] for k in wheel_order(rover)]
    axles = [rover.wheels[k].axle for k in wheel_order(rover)]
    statics = TractionTable(rover, solve_statics(rover, (SOIL,), places), 0.5 * kind.track)
    with tempfile.TemporaryDirectory() as folder:
        model = model_by_wheel(rover, places, DEFAULT_PRIOR, Path(folder) / "model.pt")
    for yaw_rate in yaw_rates:
        generator = torch.Generator().manual_seed(SEED)
        drawn = torch.rand(DRIVES, 6, generator=generator, dtype=torch.float64)
        constants = SOIL.constants() * (1.0 + CONSTANTS_OFF * (2.0 * drawn - 1.0))
        driven, _ = simulated(kind, yaw_rate, 0.0, samples, constants, generator)
        # a turn to the left: the right wheels, the last in the chassis, are outside
        slip = torch.stack([sample.slip[:, rover.axles :].mean(-1) for sample in driven], 1)
        outer = slip.unfold(1, WINDOW, 1).mean(-1).amax(-1).numpy()[:drives]
        found = observed(rover, driven, order, generator)[:drives]
        ends = [
            first_stop(model, statics, ((each, by_axle(each, axles)) for each in drive))
            for drive in found
        ]
        reasons, known = zip(*ends, strict=True)
        stopped = np.array([each is Reason.TRACTION for each in reasons])
        others = sum(each not in {Reason.NONE, Reason.TRACTION} for each in reasons)
        slips = outer > AdviceConfig().slip_limit
        yield (
            f"{yaw_rate:g} rad/s",
            f"{np.median(outer):.2f} / {outer.max():.2f}",
            f"{sum(known)} of {drives}",
            f"{stopped[slips].sum()} of {slips.sum()}",
            f"{stopped[~slips].sum()} of {(~slips).sum()}",
            f"{others} of {drives}",
        )
