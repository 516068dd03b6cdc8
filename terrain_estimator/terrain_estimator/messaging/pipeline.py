# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Messages to updates: pairing, conversion, estimator.

The node and replay both run this object.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.off_plane import SingleWheels
from terrain_estimator.estimator.saved_state import Arrays, StateFileError
from terrain_estimator.messaging.averaging import Averager, Rate
from terrain_estimator.messaging.columns import Observations, Row, can_be_columns, observed
from terrain_estimator.messaging.conversion import Conversion, Converter, Mark
from terrain_estimator.messaging.messages import (
    Meta,
    estimate_message,
    prediction_message,
    update_header,
)
from terrain_estimator.messaging.pairing import Counters, MessageSet, input_synchronizer
from terrain_estimator.messaging.sizes import bounded
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Metadata, ModelFileError
from terrain_estimator.observation import Observation
from terrain_estimator.topics import (
    BODY_FRAME,
    Make,
    Message,
    paired_inputs,
    stamp_ns,
)
from terrain_estimator.update import Update
from terramechanics.presets import load_rover
from terramechanics.vehicle.rover import Rover

MOST_WHEELS = 4
"""[1] Names in a message, over the rover's wheels, beyond which it is refused unread."""
WARM_UP_STEPS = 35
"""Observations that exercise every path of the model: three and a half blocks."""


class Answer(NamedTuple):
    """Result of one set of messages."""

    update: Update
    notes: tuple[str, ...]  # wheels and sensors that the conversion left out

    def messages(self, make: Make, meta: Meta) -> dict[str, Message]:
        """Return the outgoing messages by topic."""
        header = update_header(self.update, make, meta)
        return {
            "terrain_estimate": estimate_message(self.update, make, meta, header, self.notes),
            "motion_prediction": prediction_message(self.update, make, meta, header),
        }


class Pipeline:
    """Process input messages one by one and answer each complete set.

    It has no clock and no I/O: the result depends on stamps alone.
    """

    def __init__(self, model: LoadedModel, config: EstimatorConfig) -> None:
        """Build the parts from the configuration."""
        self.inputs = paired_inputs(use_imu=config.core.use_imu)
        self._index = {name: index for index, name in enumerate(self.inputs)}
        self._synchronizer = input_synchronizer(self.inputs, config.pairing)
        metadata = model.metadata
        rover = rover_of(metadata, config.rover)
        self.rover_name, self._wheels = rover.name, rover.wheel_names
        self._model, self._config = model, config
        by_wheel = bool(metadata.wheels)
        core = config.core.of_model(by_wheel=by_wheel)
        conversion = config.conversion.of_model(by_wheel=by_wheel)
        self._converter = Converter(rover, conversion, core, metadata.steered)
        self._averager = Averager(rover, core, SingleWheels.of(metadata))
        self._before: Arrays | None = None  # the state before the first reading
        warm_up(model, config)
        self._estimator = Estimator(model, config.core)
        self._restored = False  # whether a state was restored and nothing answered since
        self._resets = 0  # by a user, or by the clock
        self.meta = Meta(
            model_id=model.model_id,
            model_sha256=model.sha256,
            configuration_sha256=configuration_sha256(model, config),
            rows=usable_rows(model.used_rows, config.core),
            body_frame=config.conversion.body_frame or BODY_FRAME,
        )

    @property
    def counters(self) -> Mapping[str, Counters]:
        """Counts of the messages of each input."""
        return self._synchronizer.counters

    @property
    def runtime(self) -> str:
        """What runs the model."""
        return self._config.runtime

    @property
    def rate(self) -> Rate:
        """Rate of the last readings, and its treatment."""
        return self._averager.rate

    @property
    def resets(self) -> int:
        """Number of returns to the prior: by a user, by the clock, or after a long misfit."""
        return self._resets + self._estimator.reopened

    def add(self, topic: str, message: Message) -> list[Answer]:
        """Process one input message; answer the sets that it completes, usually none or one."""
        return [
            self.answer(taken)
            for complete in self.pair(topic, message)
            for taken in self.average(self.convert(complete))
        ]

    def flush(self) -> list[Answer]:
        """Answer what still waited for an optional message or for a mean, at the end of the input.

        The rate of the readings is found anew afterwards.
        """
        taken = [each for complete in self.rest() for each in self.average(self.convert(complete))]
        return [self.answer(each) for each in (*taken, *self.rest_of_means())]

    def rest(self) -> list[MessageSet]:
        """Return the sets that :meth:`flush` would answer, at the end of the input."""
        return self._synchronizer.flush()

    def pair(self, topic: str, message: Message) -> list[MessageSet]:
        """Return the sets that a message completes: the first step of :meth:`add`.

        Messages that do not concern the rover are skipped, so that they take no partner from those
        that do.
        """
        if not self._converter.concerns(topic, message):
            return []
        kept, size = bounded(topic, message, MOST_WHEELS * len(self._wheels))
        return self._synchronizer.add(
            self._index[topic], stamp_ns(message), kept, getattr(message, "sequence", None), size
        )

    def column_size(self, topic: str, example: Message, dtype: np.dtype[Any]) -> int | None:
        """Return the size [B] of messages like ``example``, whose numbers are in ``dtype``.

        None where they are not to become columns, since :meth:`pair` skips or replaces them.
        """
        if not can_be_columns(topic, example, dtype):
            return None
        if not self._converter.concerns(topic, example):
            return None
        kept, size = bounded(topic, example, MOST_WHEELS * len(self._wheels))
        return size if kept is example else None

    def pair_row(self, row: Row) -> list[MessageSet]:
        """Return the sets that a message of some columns completes, as :meth:`pair` does."""
        columns, at = row
        return self._synchronizer.add(
            self._index[columns.topic],
            columns.stamps_ns[at],
            row,
            None if columns.sequences is None else columns.sequences[at],
            columns.size,
        )

    def observe(
        self, stamps_ns: list[int], sets: Sequence[tuple[Row | None, ...]]
    ) -> Observations | None:
        """Convert sets of the same columns; None where :meth:`convert` has to."""
        return observed(self._converter, stamps_ns, sets)

    def convert(self, complete: MessageSet) -> Conversion:
        """Convert a set to an observation or a refusal: the second step of :meth:`add`."""
        return self._converter.convert(complete.stamp_ns, complete.messages)

    def average(self, conversion: Conversion) -> list[Conversion]:
        """Bring the readings to 10 Hz: the third step of :meth:`add`."""
        return self._averager.add(conversion)

    def passes(self, stamp_ns: int) -> bool:
        """Note the next reading's stamp; return whether it passes, or else goes to :meth:`take`."""
        return self._averager.passes(stamp_ns)

    def take(self, conversion: Conversion) -> list[Conversion]:
        """Bring a reading that does not pass to 10 Hz: the rest of :meth:`average`."""
        return self._averager.take(conversion)

    def rest_of_means(self) -> list[Conversion]:
        """Return the readings that still wait for a mean, at the end of the input."""
        return self._averager.flush()

    def answer(self, conversion: Conversion) -> Answer:
        """Update the estimator: the last step of :meth:`add`."""
        note = self._follow_the_clock(conversion.stamp_ns)
        if conversion.mark is Mark.FIRST:
            self._before = self._estimator.save()
        elif conversion.mark is Mark.WITHDRAWS and self._before is not None:
            self._estimator.restore(self._before)
        if conversion.observation is None:
            update = self._estimator.reject(
                conversion.stamp_ns, conversion.outcome, conversion.detail
            )
        else:
            update = self._estimator.update(conversion.observation)
        return Answer(update._replace(warnings=(note,)) if note else update, conversion.notes)

    def save(self) -> dict[str, NDArray[Any]]:
        """Return the estimator's state, without messages that wait for their partners."""
        return self._estimator.save()

    def restore(self, arrays: Arrays, where: str = "the state") -> None:
        """Continue from a saved state of the file ``where``.

        The first set that follows may have any stamp, since the saved one belongs to another run
        and a clock without a battery begins again.

        Raises:
            StateFileError: it is refused, and nothing has changed; the message begins with
                ``where``.
        """
        try:
            self._estimator.restore(arrays)
        except StateFileError as error:
            raise StateFileError(f"{where}: {error}") from error
        self._averager.reset()
        self._restored = True

    def _follow_the_clock(self, stamp_ns: int) -> str:
        """Reset where the clock was set back, and return a warning; empty otherwise.

        Pairing passes on earlier stamps only once the clock was certainly set back.
        """
        restored, self._restored = self._restored, False
        last_ns = self._estimator.last_stamp_ns
        if last_ns is None or stamp_ns >= last_ns:
            return ""
        back_s = (last_ns - stamp_ns) / 1e9
        if restored:
            self._estimator.unlink()
            return (
                f"stamps begin {back_s:.1f} s before those of the saved state, as on a computer"
                " without a battery-backed clock: the restored estimate is kept"
            )
        self._forget()
        return (
            f"the clock went back by {back_s:.1f} s, as when a bag loops: the posterior is the"
            " prior again"
        )

    def set_gate_probability(self, probability: float) -> None:
        """Change the gates from the next observation on; the fingerprint in ``meta`` follows."""
        core = dataclasses.replace(self._config.core, gate_probability=probability)
        self._config = dataclasses.replace(self._config, core=core)
        self._estimator.set_gate_probability(probability)
        sha256 = configuration_sha256(self._model, self._config)
        self.meta = dataclasses.replace(self.meta, configuration_sha256=sha256)

    def reset(self) -> None:
        """Forget the ground and the waiting messages; keep counters and sequence numbers."""
        self._synchronizer.reset()
        self._averager.reset()
        self._forget()

    def _forget(self) -> None:
        self._estimator.reset()
        self._resets += 1


def configuration_sha256(model: LoadedModel, config: EstimatorConfig) -> str:
    """Return the fingerprint of all parameters, including the contents of a rover file.

    Raises what :func:`rover_of` raises.
    """
    rover = rover_of(model.metadata, config.rover)
    contents = json.dumps(rover.content(), sort_keys=True)
    return config.sha256(hashlib.sha256(contents.encode()).hexdigest() if config.rover else "")


def warm_up(model: LoadedModel, config: EstimatorConfig) -> None:
    """Run a throwaway estimator, since torch compiles scripted methods at their first calls.

    Each compilation takes 0.1 s. Live and replay both do this, so that both are in the same state
    at the first observation.
    """
    estimator = Estimator(model, config.core)
    axles = np.ones(model.metadata.stations)
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
                torque_sd=0.5
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
                bogie_angle=0.0,
                roll=0.0,
                roll_sd=0.01,
                lateral_velocity=0.0,
                lateral_velocity_sd=0.01,
                yaw_rate=0.0,
                yaw_rate_sd=0.01,
                steering=0.0 * axles,
            )
        )


def usable_rows(rows: tuple[str, ...], config: CoreConfig) -> tuple[str, ...]:
    """Return the model's rows that the configuration leaves in use.

    A row that is switched off does not count as missing.
    """
    balances = config.use_moments and config.use_sinkage  # else they are spent on the sinkages
    used = {
        "load": config.use_sinkage,
        "torque": config.use_torque,
        "acceleration": config.use_imu,
        "moment": balances,
        "bogie_moment": balances,
        "roll_moment": config.use_moments,
    }
    off = tuple(name for name, use in used.items() if not use)
    return tuple(row for row in rows if not row.startswith(off))


def rover_of(metadata: Metadata, name: str) -> Rover:
    """Return the rover of that name or file; the model's where the name is empty.

    Only the names of rover and wheels may differ from the model's rover.

    Raises:
        ConfigError: the rover file is wrong.
        ModelFileError: the model was made for another rover.
    """
    if not name:
        return metadata.rover
    rover = load_rover(name)
    different = rover.first_difference(metadata.rover)
    if metadata.wheels and different is None:
        different = rover.other_side(metadata.rover)
    if different:
        field, value, wanted = different
        places = metadata.wheel_places
        command = (
            "train" if places is None else f"model_by_wheel --track-width {places.track_width:g}"
        )
        raise ModelFileError(
            f"rover {name}: {field} is {value}, the model {metadata.model_id} is for"
            f" {wanted}: make one for this rover, ros2 run terrain_estimator {command} --rover"
            f" {name} --soil {' '.join(soil.name for soil in metadata.soils)} --out models"
        )
    return rover
