# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of any length in constant memory: a short one repeated, with continuous stamps."""

import copy
from collections.abc import Iterator

from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.observation import Observation
from terrain_estimator.topics import Make, Message
from tests.drives import STEP_NS, Event, drive_messages

PIECE_S = 120.0
"""[s] Duration of the drive that is repeated."""


def long_drive(make: Make, seconds: float, seed: int = 1) -> Iterator[Event]:
    """Yield the five input topics at 10 Hz for ``seconds`` of simulated time, by stamp."""
    steps = round(seconds * 1e9 / STEP_NS)
    piece = list(drive_messages(make, min(PIECE_S, seconds), seed))
    first, length = piece[0][1], len({stamp for _, stamp, _ in piece})
    for done in range(0, steps, length):
        for topic, stamp_ns, message in piece:
            if done + (stamp_ns - first) // STEP_NS < steps:
                later_ns = stamp_ns + done * STEP_NS
                yield topic, later_ns, _moved(make, message, later_ns, done)


def _moved(make: Make, message: Message, stamp_ns: int, steps: int) -> Message:
    moved = copy.copy(message)
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    stamp = make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    moved.header = make("std_msgs/msg/Header", stamp=stamp, frame_id=message.header.frame_id)
    if hasattr(moved, "sequence"):
        moved.sequence = message.sequence + steps
    return moved


def observations(model: LoadedModel, seconds: float, seed: int = 1) -> list[Observation]:
    """Return the observations of such a drive; the model is warm after it."""
    pipeline = Pipeline(model, EstimatorConfig())
    sets = (
        complete
        for topic, _, message in long_drive(Types().make, seconds, seed)
        for complete in pipeline.pair(topic, message)
    )
    converted = (pipeline.convert(complete).observation for complete in sets)
    return [observation for observation in converted if observation is not None]
