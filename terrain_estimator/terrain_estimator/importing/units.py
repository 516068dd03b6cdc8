# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Units that a mapping may name, and their size in SI."""

import math

STANDARD_GRAVITY = 9.80665  # [m/s^2] of the unit g, by definition

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "ratio": {"1": 1.0, "%": 0.01},
    "length": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0},
    "wheel rate": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180.0,
        "rpm": math.pi / 30.0,
        "1/s": 2.0 * math.pi,
    },
    "yaw rate": {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    "torque": {"N m": 1.0, "N cm": 0.01, "N mm": 0.001},
    "velocity": {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001, "km/h": 1.0 / 3.6},
    "acceleration": {"m/s^2": 1.0, "mm/s^2": 0.001, "g": STANDARD_GRAVITY},
}
"""Size of each unit in SI, by quantity.

The unit 1/s of a wheel rate is revolutions per second.
"""


def factor(quantity: str, unit: str) -> float:
    """Return the size of a unit in SI.

    Raises:
        ValueError: the quantity has no such unit; the message lists its units.
    """
    known = UNITS[quantity]
    if unit not in known:
        msg = f"unknown unit {unit!r} of {quantity}: give one of {', '.join(known)}"
        raise ValueError(msg)
    return known[unit]
