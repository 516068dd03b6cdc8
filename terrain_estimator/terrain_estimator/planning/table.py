# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pull of a rover as a table over (c, tan phi, slope, slip).

The nonlinear statics are solved once; advice only looks up the table.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.interpolate import RegularGridInterpolator

from terrain_estimator.observation import Floats
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.climbing import climb
from terramechanics.vehicle.rover import Rover

COHESIONS = (0.0, 1000.0, 2500.0, 5000.0, 9000.0)
"""[Pa] Few values are enough: at given slip and sinkage, forces are affine in c and tan phi."""
TAN_PHIS = (0.02, 0.15, 0.3, 0.5, 0.75, 1.1, 1.6)
STEEPNESSES = (0.0, 0.6)
"""[rad] Up and down are alike: the pull depends on the weight across the slope alone."""
SLIPS = (-0.1, 0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.9)


@dataclass(frozen=True, slots=True)
class Pulls:
    """Pull and sinkage of n grounds for each slip of :data:`SLIPS`, [n, slips]."""

    ratio: Floats  # [1] pull over the weight across the slope
    sinkage: Floats  # [m] mean over the axles


class TractionTable:
    """Statics of one rover on some soils."""

    def __init__(self, rover: Rover, soils: Sequence[Soil]) -> None:
        """Solve the statics at every point of the table, which takes some seconds."""
        self.rover, self.soils = rover, tuple(soils)
        self._lookups = [
            RegularGridInterpolator((COHESIONS, TAN_PHIS, STEEPNESSES), _solve(rover, soil))
            for soil in soils
        ]
        self._low, self._high = (
            np.array([COHESIONS[0], TAN_PHIS[0], 0.0]),
            np.array([COHESIONS[-1], TAN_PHIS[-1], STEEPNESSES[-1]]),
        )

    def at(self, soil: int, strength: Floats, slope: Floats | float) -> Pulls:
        """Return the pulls of n grounds of one soil, with values clipped to the range of the table.

        ``strength`` [n, 2] is (c [Pa], tan phi), ``slope`` [n] or [] is in rad.
        """
        steepness = np.broadcast_to(np.abs(slope), strength.shape[:1])
        places = np.clip(np.column_stack([strength, steepness]), self._low, self._high)
        ratio, sinkage = np.moveaxis(self._lookups[soil](places), -1, 0)
        return Pulls(ratio, sinkage)


def _solve(rover: Rover, soil: Soil) -> Floats:
    """Return ratio and sinkage [cohesions, tan phis, steepnesses, slips, 2]."""
    axes = [
        torch.tensor(axis, dtype=torch.float64)
        for axis in (COHESIONS, TAN_PHIS, STEEPNESSES, SLIPS)
    ]
    cohesion, tan_phi, slope, slip = torch.cartesian_prod(*axes).unbind(1)
    constants = soil.constants().expand(slip.shape[0], 6)
    result = climb(rover, constants, torch.stack([cohesion, tan_phi], 1), slope, slip)
    both = torch.stack([result.pull / (rover.weight * torch.cos(slope)), result.sinkage], 1)
    values: Floats = both.view(*(len(axis) for axis in axes), 2).numpy()
    return values


def highest_ratio(pulls: Pulls, slip_limit: float) -> Floats:
    """Return the largest pull over weight [n] at a slip up to ``slip_limit``."""
    allowed = np.array(SLIPS) <= slip_limit + 1e-9
    return pulls.ratio[:, allowed].max(axis=1)


def slip_for(pulls: Pulls, ratio: Floats) -> tuple[Floats, Floats]:
    """Return slip and sinkage [n] at which grounds reach the ``ratio`` [n].

    Where they never do: slip 1, and the sinkage at the largest slip.
    """
    slips, count = np.array(SLIPS), ratio.shape[0]
    rising = np.maximum.accumulate(pulls.ratio, axis=1)
    after = (rising < ratio[:, None]).sum(axis=1)
    right = np.clip(after, 1, len(SLIPS) - 1)
    row = np.arange(count)
    low, high = rising[row, right - 1], rising[row, right]
    share = np.clip((ratio - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
    slip = np.where(
        after == len(SLIPS), 1.0, slips[right - 1] + share * (slips[right] - slips[right - 1])
    )
    sinkage = pulls.sinkage[row, right - 1] + share * (
        pulls.sinkage[row, right] - pulls.sinkage[row, right - 1]
    )
    return slip, sinkage


def steepest(
    table: TractionTable, soil: int, strength: Floats, slip_limit: float, shift: Floats
) -> Floats:
    """Return the slope [n] [rad] that the largest ratio, plus ``shift`` [n], just holds.

    Negative: downhill only.
    """
    slope = np.zeros(strength.shape[0])
    for _ in range(2):  # the ratio changes by a few per cent over the whole range of slopes
        slope = np.arctan(highest_ratio(table.at(soil, strength, slope), slip_limit) + shift)
    return np.clip(slope, -math.pi / 4.0, math.pi / 4.0)
