# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of what the planner asks of the physics, so that its node needs neither torch nor scipy.

``planning.solving`` computes them once for each model, when the model's core is compiled.
"""

import io
import itertools
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from rover_parameters.regular_file import read_regular
from terrain_estimator.observation import Floats

COHESIONS = (0.0, 1000.0, 2500.0, 5000.0, 9000.0)
"""[Pa] Few values are enough: at given slip and sinkage, forces are affine in c and tan phi."""
TAN_PHIS = (0.02, 0.15, 0.3, 0.5, 0.75, 1.1, 1.6)
STEEPNESSES = (0.0, 0.6)
"""[rad] Up and down are alike: the pull depends on the weight across the slope alone."""
TURNS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.45, 0.495, 0.51, 0.55, 0.7, 1.0)
"""[1] Share of the outer wheels' speed that turns a rover that does not steer.

0 is straight on, 0.5 about the inner wheels, 1 on the spot. Least pull is left just below 0.5,
where the inner wheels drag; beyond they drive backwards, which pulls. So nodes are close there, and
none is on the step itself.
"""
NOT_HELD = -0.35
"""[1] Pull over weight below which a table's value comes of turns that no rate of wheels holds.

It lies above the mark of such turns, NO_PULL of ``terramechanics.vehicle.turning``.
"""
SLIPS = (-0.1, 0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.9)
ENTRY_ANGLES = np.linspace(0.0, 0.5 * np.pi, 129)
"""[rad] acos(1 - z / r) of a wheel that sinks by z: forces are smooth in it, not in z."""
_LARGEST = 1 << 26  # bytes; three soils take 2 MB, with turns 4
ENDING = ".statics.npz"
"""How the name of a file of these tables ends; it begins with the model's."""


class StaticsError(ValueError):
    """A file of statics is missing, damaged or of another model; the text says which."""


@dataclass(frozen=True, slots=True)
class Statics:
    """Statics of one rover on S soils, and the forces on one of its wheels."""

    pulls: Floats
    """[S, COHESIONS, TAN_PHIS, STEEPNESSES, turns, SLIPS, 2] Pull over the weight across the slope
    [1], and mean sinkage [m], of the whole rover with all wheels at one slip, in a turn those
    outside. There are all TURNS, or the first alone where turns are not known."""
    wheel_slips: Floats
    """[S, n] Slips [1] at which ``wheel`` is known: the range of the contact law."""
    wheel: Floats
    """[S, n, ENTRY_ANGLES, 2, 3] N [N] and M [N m] of one wheel, each affine in (c [Pa], tan phi,
    1)."""
    balances: Floats
    """[3 + joints, axles, 3, 3] Balances of rover and joints per N, T, M of the wheels of each
    axle, each affine in (cos a, sin a, 1) of the contact angle a there. They determine the loads
    where there is one more of them than axles."""

    def __post_init__(self) -> None:
        """Raise StaticsError where a shape is wrong or a number is not finite."""
        soils, axles, slips = len(self.pulls), self.balances.shape[1], self.wheel_slips.shape[-1]
        turns = len(TURNS) if self.pulls.ndim > 4 and self.pulls.shape[4] > 1 else 1
        grid = (len(COHESIONS), len(TAN_PHIS), len(STEEPNESSES), turns, len(SLIPS), 2)
        shapes = {
            "pulls": (soils, *grid),
            "wheel_slips": (soils, slips),
            "wheel": (soils, slips, len(ENTRY_ANGLES), 2, 3),
            "balances": (max(3, min(len(self.balances), axles + 1)), axles, 3, 3),
        }
        for name, shape in shapes.items():
            found = getattr(self, name)
            if found.shape != shape or found.dtype != np.float64 or not np.isfinite(found).all():
                raise StaticsError(f"{name} is not finite doubles of shape {shape}")


def write_statics(path: Path, statics: Statics, sha256: str) -> None:
    """Write the statics of the model with this hash; raises OSError."""
    with path.open("wb") as file:
        np.savez(file, model=np.array(sha256), **asdict(statics))


def read_statics(path: Path, sha256: str) -> Statics:
    """Return the statics in a file of the model with this hash.

    Raises StaticsError where they are of another model, or damaged.
    """
    try:
        with np.load(io.BytesIO(read_regular(path, _LARGEST)), allow_pickle=False) as archive:
            found = str(archive["model"])
            arrays = {name: archive[name] for name in Statics.__slots__}
        if found != sha256:
            raise StaticsError(f"made from the model {found[:12]}, this is {sha256[:12]}")
        return Statics(**arrays)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, IndexError) as error:
        raise StaticsError(f"{path}: {error}: build them anew") from error


def interpolate(axes: Sequence[Floats], values: Floats, places: Floats) -> Floats:
    """Return ``values`` [*axes, ...] at n ``places`` [n, axes], linear in every axis: [n, ...].

    Beyond the ends of an axis the value at its end holds.
    """
    left, share = [], []
    for axis, place in zip(axes, places.T, strict=True):
        index = np.clip(np.searchsorted(axis, place, side="right") - 1, 0, len(axis) - 2)
        left.append(index)
        share.append(np.clip((place - axis[index]) / (axis[index + 1] - axis[index]), 0.0, 1.0))
    total = np.zeros((len(places), *values.shape[len(axes) :]))
    for corner in itertools.product((0, 1), repeat=len(axes)):
        weight = np.ones(len(places))
        for right, each in zip(corner, share, strict=True):
            weight *= each if right else 1.0 - each
        place = tuple(index + right for index, right in zip(left, corner, strict=True))
        total += weight.reshape(-1, *[1] * (total.ndim - 1)) * values[place]
    return total
