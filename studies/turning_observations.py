# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Observations of simulated drives of a rover that leans, turns or slides to a side."""

import dataclasses

import numpy as np
import torch
from torch import Tensor

from rover_sim_node.turning_run import LATERAL_SD, YAW_RATE_SD
from studies.observations import observations_of
from terrain_estimator.observation import Floats, Observation
from terramechanics.simulation.sample import Measurement
from terramechanics.simulation.sensors import Noise


def turning_observations_of(
    measured: Measurement,
    roll: Tensor,
    lateral_velocity: Tensor,
    yaw_rate: Tensor,
    generator: torch.Generator,
) -> list[list[Observation]]:
    """Return the observations of every drive, with the simulator node's noise of these motions.

    ``measured`` is of all drives [drives, time], as are the true ``roll`` [rad], lateral velocity
    [m/s] and yaw rate [rad/s].
    """

    def seen(true: Tensor, deviation: float) -> Floats:
        noise = torch.randn(true.shape, generator=generator, dtype=torch.float64)
        return np.asarray(true + deviation * noise)

    lean = seen(roll, Noise().pitch)
    aside, turn = seen(lateral_velocity, LATERAL_SD), seen(yaw_rate, YAW_RATE_SD)
    return [
        [
            dataclasses.replace(
                one,
                roll=float(lean[drive, step]),
                roll_sd=Noise().pitch,
                lateral_velocity=float(aside[drive, step]),
                lateral_velocity_sd=LATERAL_SD,
                yaw_rate=float(turn[drive, step]),
                yaw_rate_sd=YAW_RATE_SD,
            )
            for step, one in enumerate(observations_of(measured, drive))
        ]
        for drive in range(roll.shape[0])
    ]
