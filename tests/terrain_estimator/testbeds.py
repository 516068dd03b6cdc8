# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A testbed with one wheel."""

from terrain_estimator.discovery.single_wheel.cells import Rig, wheel_alone
from terramechanics.presets import load_rover, load_soil

RIG = Rig(
    wheel_alone(load_rover("mars_rover"), 0.1, 0.08),
    load_soil("loose_sand"),
    (0.05,) * 5,
    (1e-3, 1.0, 1.0, 0.1),
)
