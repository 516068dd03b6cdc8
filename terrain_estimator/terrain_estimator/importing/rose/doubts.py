# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a trial cannot mean: poses, wheels, axes, signs and units that contradict each other."""

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.importing.plausibility import FEWEST
from terrain_estimator.importing.rose.samples import Found
from terrain_estimator.importing.rose.schema import RoseOptions, axis, axis_near
from terrain_estimator.importing.units import UNITS
from terramechanics.vehicle.rover import Rover

Array: TypeAlias = NDArray[Any]
_SLOWEST_RIM = 0.01  # [m/s] of a wheel that turns
_FASTEST = 2.5  # [1] of the rims' speed: a rover that slides down has less
_SAME = 1.3  # [1] up to which a ratio is that of two units
_ALONG = 0.7  # [1] smallest share of a drive along the forward axis


def faults(found: Found, rover: Rover, options: RoseOptions) -> Iterator[str]:
    """Yield what makes a trial impossible, and what to do."""
    rims = np.array(found.rates) * rover.wheel_radius
    travel = np.array([motion.travel for motion in found.motions])
    yaw = np.array([motion.yaw_rate for motion in found.motions])
    with np.errstate(invalid="ignore"):
        straight = (np.abs(yaw) < options.turn_rate) & (_length(travel) > _SLOWEST_RIM)
        against = _against(rims, straight)
        together = straight & (np.abs(rims.mean(1)) > _SLOWEST_RIM)  # not on the spot
    if against:
        yield (
            f"wheels {' and '.join(map(str, against))} turn against wheel 1 while the rover"
            " drives straight: give --wheel-signs"
        )
        return
    if together.sum() < FEWEST:
        return
    mean, sense = rims[together].mean(1), np.sign(rims[together].mean(1))
    direction = np.median(travel[together] * sense[:, None], axis=0)
    speed = float(np.linalg.norm(direction))
    forward, up = (axis(name) for name in options.body_axes)
    rim = float(np.median(np.abs(mean)))
    if speed > _SLOWEST_RIM and direction @ forward < _ALONG * speed:
        moved = axis_near(direction - up * (direction @ up))
        yield (
            f"the wheels drive forward, but the pose moves along {moved} of its frame: give"
            f" --body-axes={moved},{options.body_axes[1]}, or --wheel-signs if the signs of the"
            " wheels are wrong"
        )
        return
    ratio = speed / rim
    if ratio > _FASTEST:
        yield (
            f"the pose moves {ratio:.3g} times as fast as the rims: {_units(ratio, options)}give"
            " the right --rover (its wheel radius counts)"
        )


def doubts(found: Found, rover: Rover, options: RoseOptions) -> Iterator[str]:
    """Yield what is possible, but looks like a wrong unit."""
    rims = np.abs(np.array(found.rates).mean(1)) * rover.wheel_radius
    speeds = np.array([abs(motion.velocity[1]) for motion in found.motions])
    with np.errstate(invalid="ignore"):
        turns = rims > _SLOWEST_RIM
    if turns.sum() >= FEWEST and speeds[turns].any():
        ratio = float(np.median(speeds[turns]) / np.median(rims[turns]))
        if ratio < 0.1 and (hint := _units(ratio, options)):
            hint = hint.removesuffix(", or ")
            yield f"the pose moves {ratio:.3g} times as fast as the rims: if it is not stuck {hint}"


def _against(rims: Array, straight: Array) -> list[int]:
    """Return the numbers of wheels that turn against wheel 1 while the rover drives straight."""
    chosen = rims[straight & (np.abs(rims) > _SLOWEST_RIM).all(1)]
    if len(chosen) < FEWEST:
        return []
    share = (chosen * chosen[:, :1] < 0.0).mean(0)
    return [wheel + 1 for wheel in np.flatnonzero(share > 0.9).tolist()]


def _units(ratio: float, options: RoseOptions) -> str:
    """Return the options by which a ratio of pose and rims would be near 1, each with ", "."""
    said = []
    for option, stated, quantity, wanted in (
        ("--position-unit", options.position_unit, "length", 1.0 / ratio),
        ("--rate-unit", options.rate_unit, "wheel rate", ratio),
    ):
        units = UNITS[quantity]
        said += [
            f"{option} {unit}"
            for unit, size in units.items()
            if unit != stated and 1.0 / _SAME < size / units[stated] / wanted < _SAME
        ]
    return f"give {' or '.join(said)}, or " if said else ""


def _length(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
