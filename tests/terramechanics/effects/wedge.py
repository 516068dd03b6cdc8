# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The resistance of a wedge by hand, with the numbers of docs/effects.md."""

from terramechanics.terrain.soil import Soil


def resistance(size: float, sinkage: float, soil: Soil, cohesive: float = 0.75) -> float:
    """Return the force [N] of a wedge of ``size`` [N/m^2] on ``soil``."""
    by_cohesion = cohesive * 0.02 * soil.cohesion / 2000.0
    by_friction = (1.0 - cohesive) * sinkage * soil.tan_phi / 0.58
    return size * sinkage * (by_cohesion + by_friction)
