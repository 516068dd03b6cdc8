# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pull of a rover as a table over (c, tan phi, slope, turn, slip).

The nonlinear statics are solved once; advice only looks up the table.
"""

import math
from dataclasses import dataclass

import numpy as np

from terrain_estimator.observation import Floats
from terrain_estimator.planning.statics import (
    COHESIONS,
    ENTRY_ANGLES,
    SLIPS,
    STEEPNESSES,
    TAN_PHIS,
    TURNS,
    Statics,
    interpolate,
)
from terramechanics.vehicle.rover import Rover

_GROUND = tuple(np.array(axis) for axis in (COHESIONS, TAN_PHIS, STEEPNESSES))
_TURNS = np.array(TURNS)


@dataclass(frozen=True, slots=True)
class Pulls:
    """Pull and sinkage of n grounds for each slip of :data:`SLIPS`, [n, slips]."""

    ratio: Floats  # [1] pull over the weight across the slope
    sinkage: Floats  # [m] mean over the axles


@dataclass(frozen=True, slots=True)
class TractionTable:
    """Statics of one rover on some soils."""

    rover: Rover
    statics: Statics
    half_track: float = math.nan  # [m] NaN: of a model by axle, which knows no turns

    @property
    def soils(self) -> int:
        """Return the number of soils."""
        return len(self.statics.pulls)

    @property
    def knows_turns(self) -> bool:
        """Return whether it holds the pulls in turns."""
        return self.statics.pulls.shape[4] > 1

    @property
    def knows_loads(self) -> bool:
        """Return whether balances determine the loads of the axles."""
        rows, axles = self.statics.balances.shape[:2]
        return rows == axles + 1

    def turn_of(self, velocity: float, yaw_rate: float) -> float:
        """Return the share of the outer wheels' speed that turns the rover [1], left or right.

        0 where it stands, or where its turns are not known.

        ``velocity`` [m/s] is along the body, ``yaw_rate`` in rad/s.
        """
        turning, ahead = abs(yaw_rate) * self.half_track, abs(velocity)
        return turning / (turning + ahead) if turning > 0.0 else 0.0

    def at(self, soil: int, strength: Floats, slope: Floats | float, turn: float = 0.0) -> Pulls:
        """Return the pulls of n grounds of one soil, with values clipped to the range of the table.

        ``strength`` [n, 2] is (c [Pa], tan phi), ``slope`` [n] or [] is in rad, ``turn`` a share as
        in :data:`~terrain_estimator.planning.statics.TURNS`, 0 where turns are not known.
        """
        steepness = np.broadcast_to(np.abs(slope), strength.shape[:1])
        places, pulls = [strength, steepness], self.statics.pulls[soil]
        if self.knows_turns:
            places.append(np.full(len(strength), turn))
            found = interpolate((*_GROUND, _TURNS), pulls, np.column_stack(places))
        else:
            found = interpolate(_GROUND, pulls[..., 0, :, :], np.column_stack(places))
        ratio, sinkage = np.moveaxis(found, -1, 0)
        return Pulls(ratio, sinkage)

    def wheel(self, soil: int, slip: float, sinkage: float) -> Floats | None:
        """Return N [N] and M [N m] of one wheel, affine in (c [Pa], tan phi, 1): [2, 3].

        None where the contact law does not hold at this slip [1] and sinkage [m].
        """
        slips, radius = self.statics.wheel_slips[soil], self.rover.wheel_radius
        if not (slips[0] <= slip <= slips[-1] and 0.0 < sinkage < radius):
            return None
        place = np.array([[slip, math.acos(1.0 - sinkage / radius)]])
        forces: Floats = interpolate((slips, ENTRY_ANGLES), self.statics.wheel[soil], place)[0]
        return forces

    def loads(self, pitch: float, contact_angle: Floats, traction: float, torque: Floats) -> Floats:
        """Return the normal force [axles] [N] of a wheel of each axle of a rover that holds still.

        ``contact_angle`` [axles] [rad] is that of the ground relative to the body, ``traction`` [N]
        that of every wheel, ``torque`` [axles] [N m] that of one wheel of each axle. Solves what
        ``terramechanics.vehicle.suspension.wheel_loads`` solves; the table has to know loads.
        """
        one = np.ones_like(contact_angle)
        angle = np.stack([np.cos(contact_angle), np.sin(contact_angle), one])
        matrix = np.einsum("rafk,ka->raf", self.statics.balances, angle)[1:]
        known = (matrix[..., 1] * traction + matrix[..., 2] * torque).sum(-1)
        across = np.zeros(self.rover.axles)
        across[0] = self.rover.weight * math.cos(pitch)
        loads: Floats = np.linalg.solve(matrix[..., 0], across - known)
        return loads


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
    table: TractionTable,
    soil: int,
    strength: Floats,
    slip_limit: float,
    shift: Floats,
    turn: float = 0.0,
) -> Floats:
    """Return the slope [n] [rad] that the largest ratio, plus ``shift`` [n], just holds in a turn.

    Negative: downhill only.
    """
    slope = np.zeros(strength.shape[0])
    for _ in range(2):  # the ratio changes by a few per cent over the whole range of slopes
        slope = np.arctan(highest_ratio(table.at(soil, strength, slope, turn), slip_limit) + shift)
    return np.clip(slope, -math.pi / 4.0, math.pi / 4.0)
