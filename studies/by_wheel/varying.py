# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Models by wheel on ground that differs from place to place.

Rovers turn on level ground for a minute, with every sensor. c, tan phi and the stiffness of the
ground differ independently every SPACING, in both directions.
"""

import dataclasses
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

from studies.by_wheel.drives import ended, model_by_wheel
from studies.by_wheel.motions import CONSTANTS_OFF
from studies.off_plane import SOIL, Kind, simulated
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.learning.observing import observed
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.presets import load_rover
from terramechanics.terrain.field import random_mesh
from terramechanics.vehicle.steering import steered_command
from terramechanics.vehicle.wheel_places import WheelPlaces, chassis_places, wheel_order

SEED = 83_000_000
DRIVES, SAMPLES = 48, 600
SPACING, EXTENT = 0.3, 20.0
"""[m] Distance of the nodes of the ground, and how far they reach."""
YAW_RATES = {"four_wheel_rover": 0.2, "mars_rover": 0.05}
"""[rad/s] commanded."""
GROUNDS = ((0.0, 0.0), (0.0, 0.02), (0.02, 0.0), (0.02, 0.02), (0.05, 0.0), (0.05, 0.05))
"""[1] Deviation of the ground, and the one that the model is made for."""
HEAD = (
    "ground varies by",
    "model made for",
    "IDENTIFIED",
    "DISAGREES",
    "sound",
    "c / tan phi in their interval",
    "error of c / tan phi",
    "stated deviation",
)


def varying_lines(
    kind: Kind,
    drives: int = DRIVES,
    samples: int = SAMPLES,
    grounds: Sequence[tuple[float, float]] = GROUNDS,
) -> Iterator[list[str]]:
    """Yield the lines of a rover's table, one for each of the ``grounds``."""
    rover = load_rover(kind.rover)
    steered = rover.wheel_names if kind.command is steered_command else ()
    places = WheelPlaces(kind.track, kind.yaw_inertia, steered)
    in_chassis = chassis_places(rover)
    order = [in_chassis[k] for k in wheel_order(rover)]
    for share, told in grounds:
        prior = dataclasses.replace(DEFAULT_PRIOR, ground_variation=told)
        with tempfile.TemporaryDirectory() as folder:
            model = model_by_wheel(rover, places, prior, Path(folder) / "model.pt")
        generator = torch.Generator().manual_seed(SEED)
        drawn = torch.rand(drives, 6, generator=generator, dtype=torch.float64)
        constants = SOIL.constants() * (1.0 + CONSTANTS_OFF * (2.0 * drawn - 1.0))
        field = random_mesh(drives, share, SPACING, EXTENT, generator)
        driven, strength = simulated(
            kind, YAW_RATES[kind.rover], 0.0, samples, constants, generator, field=field
        )
        found = observed(rover, driven, order, generator, None, 0.0)
        result = ended(model, found, strength.numpy(), CoreConfig())
        status = Counter(status_of(each, result.rows) for each in result.updates)
        error = 100.0 * np.median(np.abs(result.mean / result.truth - 1.0), 0)
        spread = 100.0 * np.median(result.deviation / result.truth, 0)
        held = result.holds.sum(0)
        yield [
            f"{100.0 * share:g} %",
            f"{100.0 * told:g} %",
            f"{status[Status.IDENTIFIED]}",
            f"{status[Status.DISAGREES]}",
            f"{(~result.identified | result.holds.all(1)).sum()} of {drives}",
            f"{held[0]} / {held[1]}",
            f"{error[0]:.1f} / {error[1]:.1f} %",
            f"{spread[0]:.1f} / {spread[1]:.1f} %",
        ]
