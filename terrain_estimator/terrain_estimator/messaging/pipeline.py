# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""From messages to updates: pairing, conversion, estimator. The node and replay run this one object."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.config import CoreConfig, EstimatorConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.saved_state import Arrays
from terrain_estimator.messaging.conversion import Conversion, Converter
from terrain_estimator.messaging.messages import (
    Meta,
    estimate_message,
    prediction_message,
    update_header,
)
from terrain_estimator.messaging.pairing import Counters, InputTopic, MessageSet, Synchronizer
from terrain_estimator.model.model_file import LoadedModel, ModelFileError
from terrain_estimator.observation import Observation
from terrain_estimator.ros_types import (
    BODY_FRAME,
    REQUIRED_INPUTS,
    Make,
    Message,
    paired_inputs,
    stamp_ns,
)
from terrain_estimator.update import Update
from terramechanics.vehicle.rover import Rover, load_rover

WARM_UP_STEPS = 35
"""Observations that go through every path of the model: three blocks and a half."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What follows from one set of messages."""

    update: Update
    notes: tuple[str, ...]  # wheels and sensors that the conversion left out

    def messages(self, make: Make, meta: Meta) -> dict[str, Message]:
        """The outgoing messages, by topic."""
        header = update_header(self.update, make, meta)
        return {
            "terrain_estimate": estimate_message(self.update, make, meta, header, self.notes),
            "motion_prediction": prediction_message(self.update, make, meta, header),
        }


class Pipeline:
    """Takes the input messages one by one and answers each complete set. No clock, no I/O: stamps decide."""

    def __init__(self, model: LoadedModel, config: EstimatorConfig) -> None:
        """Build the parts from the configuration."""
        self.inputs = paired_inputs(use_imu=config.core.use_imu)
        topics = tuple(InputTopic(name, name in REQUIRED_INPUTS) for name in self.inputs)
        self._index = {name: index for index, name in enumerate(self.inputs)}
        self._synchronizer = Synchronizer(
            topics, round(config.pairing.tolerance_s * 1e9), round(config.pairing.timeout_s * 1e9)
        )
        rover = rover_of(model, config.rover)
        self.rover_name = rover.name
        self._converter = Converter(rover, config.conversion, config.core)
        warm_up(model, config)
        self._estimator = Estimator(model, config.core)
        self._restored = False  # and nothing was answered since
        self._resets = 0  # by a user, or by the clock
        self.meta = Meta(
            model_id=model.model_id,
            model_sha256=model.sha256,
            configuration_sha256=configuration_sha256(model, config),
            rows=usable_rows(model.rows, config.core),
            body_frame=config.conversion.body_frame or BODY_FRAME,
        )

    @property
    def counters(self) -> Mapping[str, Counters]:
        """What happened to the messages of each input."""
        return self._synchronizer.counters

    @property
    def resets(self) -> int:
        """Times that the posterior became the prior: by a user, by the clock, or because nothing had fitted for long."""
        return self._resets + self._estimator.reopened

    def add(self, topic: str, message: Message) -> list[Answer]:
        """Take one message of an input topic; answer the sets that it completes, usually none or one."""
        return [self.answer(self.convert(complete)) for complete in self.pair(topic, message)]

    def flush(self) -> list[Answer]:
        """At the end of the input: answer the sets that still waited for an optional message."""
        return [self.answer(self.convert(complete)) for complete in self.rest()]

    def rest(self) -> list[MessageSet]:
        """At the end of the input, in place of ``flush``: the sets that it would answer."""
        return self._synchronizer.flush()

    def pair(self, topic: str, message: Message) -> list[MessageSet]:
        """First step of ``add``: the sets that a message completes. What does not concern the rover takes no partner from what does."""
        if not self._converter.concerns(topic, message):
            return []
        return self._synchronizer.add(
            self._index[topic], stamp_ns(message), message, getattr(message, "sequence", None)
        )

    def convert(self, complete: MessageSet) -> Conversion:
        """Second step of ``add``: the observation of a set, or why there is none."""
        return self._converter.convert(complete.stamp_ns, complete.messages)

    def answer(self, conversion: Conversion) -> Answer:
        """Third step of ``add``: what the estimator says to it."""
        note = self._follow_the_clock(conversion.stamp_ns)
        if conversion.observation is None:
            update = self._estimator.reject(
                conversion.stamp_ns, conversion.outcome, conversion.detail
            )
        else:
            update = self._estimator.update(conversion.observation)
        return Answer(
            dataclasses.replace(update, warnings=(note,)) if note else update, conversion.notes
        )

    def save(self) -> dict[str, NDArray[Any]]:
        """The estimator's state; messages that wait for their partners are not part of it."""
        return self._estimator.save()

    def restore(self, arrays: Arrays) -> None:
        """Go on from a saved state. Raises StateFileError, and changes nothing then.

        Its last stamp is that of another run: the first set that follows may have any, since clocks
        that nothing keeps begin anew.
        """
        self._estimator.restore(arrays)
        self._restored = True

    def _follow_the_clock(self, stamp_ns: int) -> str:
        """Reset where the clock was set back, and say so: pairing lets earlier stamps through only once that is certain."""
        restored, self._restored = self._restored, False
        last_ns = self._estimator.last_stamp_ns
        if last_ns is None or stamp_ns >= last_ns:
            return ""
        back_s = (last_ns - stamp_ns) / 1e9
        if restored:
            self._estimator.unlink()
            return (
                f"stamps begin {back_s:.1f} s before those of the saved state, as on a computer"
                " that keeps no time: what is known stays"
            )
        self._forget()
        return (
            f"the clock went back by {back_s:.1f} s, as when a bag loops: the posterior is the"
            " prior again"
        )

    def reset(self) -> None:
        """Forget the ground and the waiting messages; counters and sequence numbers go on."""
        self._synchronizer.reset()
        self._forget()

    def _forget(self) -> None:
        self._estimator.reset()
        self._resets += 1


def configuration_sha256(model: LoadedModel, config: EstimatorConfig) -> str:
    """Fingerprint of all parameters, the contents of a rover file among them. Raises as :func:`rover_of`."""
    contents = json.dumps(dataclasses.asdict(rover_of(model, config.rover)), sort_keys=True)
    return config.sha256(hashlib.sha256(contents.encode()).hexdigest() if config.rover else "")


def warm_up(model: LoadedModel, config: EstimatorConfig) -> None:
    """Run an estimator that is thrown away: torch compiles a scripted method at its first calls, which takes 0.1 s each.

    Live and replay do the same, so that both are in the same state at the first observation.
    """
    estimator = Estimator(model, config.core)
    axles = np.ones(model.rover.axles)
    step_ns = round(model.metadata.step_s * 1e9)
    for step in range(WARM_UP_STEPS):
        estimator.update(
            Observation(
                stamp_ns=step * step_ns,
                slip=0.2 * axles,
                slip_sd=0.05 * axles,
                sinkage=0.1 * model.rover.wheel_radius * axles,
                sinkage_sd=0.01 * model.rover.wheel_radius * axles,
                contact_angle=0.0 * axles,
                contact_angle_sd=0.01 * axles,
                wheel_rate=0.1 / model.rover.wheel_radius * axles,
                torque=0.3
                * model.rover.wheel_radius
                * model.rover.weight
                / len(model.rover.wheels)
                * axles,
                torque_sd=0.1
                * model.rover.wheel_radius
                * model.rover.weight
                / len(model.rover.wheels)
                * axles,
                velocity=0.08,
                velocity_sd=0.01,
                pitch=0.0,
                pitch_sd=0.01,
                acceleration=0.0,
                acceleration_sd=0.05,
            )
        )


def usable_rows(rows: tuple[str, ...], config: CoreConfig) -> tuple[str, ...]:
    """Of a model's rows those that the configuration leaves it: one that is switched off is not missing."""
    used = {
        "torque": config.use_torque,
        "acceleration": config.use_imu,
        "moment": config.use_moments,
        "bogie_moment": config.use_moments,
    }
    off = tuple(name for name, use in used.items() if not use)
    return tuple(row for row in rows if not row.startswith(off))


def rover_of(model: LoadedModel, name: str) -> Rover:
    """The rover of that name or file, the model's where the name is empty. Names of rover and wheels may differ from the model's rover.

    Raises:
        ConfigError: the rover file is wrong.
        ModelFileError: the model was made for another rover.
    """
    if not name:
        return model.rover
    rover = load_rover(name)
    for entry in dataclasses.fields(rover):
        value, wanted = getattr(rover, entry.name), getattr(model.rover, entry.name)
        if entry.name == "wheels":
            value, wanted = sorted(rover.wheel_axle), sorted(model.rover.wheel_axle)
        if entry.name != "name" and value != wanted:
            raise ModelFileError(
                f"rover {name}: {entry.name} is {value}, the model {model.model_id} is for"
                f" {wanted}: train a model for this rover"
            )
    return rover
