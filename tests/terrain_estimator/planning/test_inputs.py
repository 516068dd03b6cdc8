# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The planner's measurements: paired as the estimator's, with the sensors that are switched on."""

import copy

import numpy as np
import pytest

from rover_parameters.parameters import configure
from terrain_estimator.bags import Types
from terrain_estimator.config.planner import PlannerConfig
from terrain_estimator.observation import Observation
from terrain_estimator.planning.inputs import PlannerInputs
from terrain_estimator.topics import INPUT_TYPES
from tests.drives import drive_messages
from tests.terrain_estimator.planning.support import ROVER


def paired(late_ns: int, *topics: str, **values: float) -> int:
    """Observations of a drive on some topics, its odometry stamped late."""
    inputs, count = PlannerInputs(ROVER, configure(PlannerConfig, values)), 0
    for topic, _, message in drive_messages(Types().make, 2.0):
        if topic == "odom":
            message.header.stamp = copy.deepcopy(message.header.stamp)  # all topics share it
            message.header.stamp.nanosec += late_ns
        count += len(inputs.add(topic, message)) if topic in topics else 0
    return count


def test_messages_are_paired_as_the_estimator_pairs_them() -> None:
    assert (
        paired(10_000_000, *INPUT_TYPES),
        paired(10_000_000, *INPUT_TYPES, pairing_tolerance=0.02),
    ) == (0, 20)
    without_imu = [topic for topic in INPUT_TYPES if topic != "imu"]
    assert paired(0, *without_imu, pairing_timeout=0.1) == paired(0, *without_imu) + 4
    assert paired(0, *without_imu, use_imu=False) == 20, (
        "every instant at once: what is not used is not waited for"
    )


def observed(**values: bool) -> list[Observation]:
    """Observations of a drive whose imu sits at an angle that odom does not have."""
    inputs, observations = PlannerInputs(ROVER, configure(PlannerConfig, values)), []
    for topic, _, message in drive_messages(Types().make, 2.0):
        if topic == "imu":
            message.orientation = copy.deepcopy(message.orientation)  # odom has the same
            message.orientation.y += 0.01
        found = inputs.add(topic, message) if topic in inputs.topics else []
        observations += [each for each in found if each is not None]
    assert len(observations) == 20
    return observations


def test_a_sensor_that_is_switched_off_is_not_used() -> None:
    everything, last = observed(), -1
    assert np.isfinite(everything[last].torque).all()
    assert np.isnan(observed(use_torque=False)[last].torque).all()
    assert np.isnan(observed(use_sinkage=False)[last].sinkage).all()
    assert np.isfinite(observed()[last].sinkage).all()
    assert observed(use_imu=False)[last].pitch == pytest.approx(
        everything[last].pitch + 0.02, abs=1e-3
    )
