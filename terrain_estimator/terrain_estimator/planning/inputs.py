# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measurements of the planner: messages of several topics in, observations out."""

import dataclasses

import numpy as np

from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.config.planner import PlannerConfig
from terrain_estimator.estimator.wheel_tracks import WheelTracks
from terrain_estimator.messaging.conversion import Converter
from terrain_estimator.messaging.pairing import input_synchronizer
from terrain_estimator.observation import Observation
from terrain_estimator.topics import Message, paired_inputs, stamp_ns
from terramechanics.vehicle.rover import Rover


class PlannerInputs:
    """Pair the input topics and convert complete sets.

    Sets that cannot be converted are left to the estimator to report.
    """

    def __init__(self, rover: Rover, config: PlannerConfig) -> None:
        """Start without messages; any frame is accepted, since the estimator refuses wrong ones."""
        core = CoreConfig(use_torque=config.use_torque, use_imu=config.use_imu)
        self.topics = paired_inputs(use_imu=config.use_imu)
        self._synchronizer = input_synchronizer(self.topics, config.pairing)
        self._use_sinkage = config.use_sinkage
        self._converter = Converter(rover, ConversionConfig(body_frame=""), core)
        self._tracks = WheelTracks(rover, None, config.advice.standstill_speed)

    def add(self, topic: str, message: Message) -> list[Observation | None]:
        """Add one message of ``topics``; return the observations that it completes.

        None stands for a set that cannot be converted.
        """
        if not self._converter.concerns(topic, message):
            return []
        sets = self._synchronizer.add(self.topics.index(topic), stamp_ns(message), message)
        found = (
            self._converter.convert(complete.stamp_ns, complete.messages).observation
            for complete in sets
        )
        return [each if each is None else self._with_sinkage(each) for each in found]

    def _with_sinkage(self, observation: Observation) -> Observation:
        """Return the observation with sinkages from undisturbed ground, or without any."""
        if self._use_sinkage:
            return self._tracks.undisturbed(observation)
        return _without_sinkage(observation)


def _without_sinkage(observation: Observation) -> Observation:
    return dataclasses.replace(observation, sinkage=np.full_like(observation.sinkage, np.nan))
