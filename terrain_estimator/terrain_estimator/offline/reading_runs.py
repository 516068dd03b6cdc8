# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read a run of a discovery from its bag, with the estimator's own pairing and conversion."""

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from terrain_estimator.bags import BagError, BagReader, recover
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.proof.held_out import long_enough
from terrain_estimator.discovery.runs import (
    Blocks,
    RecordedRun,
    Refusals,
    RunError,
    cut,
    cut_by_wheel,
    run_of,
)
from terrain_estimator.estimator.off_plane import SingleWheels
from terrain_estimator.estimator.wheel_tracks import WheelTracks
from terrain_estimator.messaging.averaging import Averager, averaged
from terrain_estimator.messaging.conversion import Converter
from terrain_estimator.messaging.pairing import MessageSet, input_synchronizer
from terrain_estimator.model.physics_of_wheels import physics_by_wheel
from terrain_estimator.observation import Observation
from terrain_estimator.offline.bag_options import BagOptions
from terrain_estimator.offline.topic_mapping import TopicError, check_inputs
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import INPUT_TYPES, REQUIRED_INPUTS, stamp_ns
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces

TAKE_DAMAGED = "--take-damaged"
"""The option with which what is left of a damaged bag counts as a run."""


@dataclass(frozen=True, slots=True)
class ReadRun:
    """A run as it was read, or why it cannot be used."""

    blocks: Blocks | None
    reason: str = ""  # why there are none
    lost: str = ""  # what is missing from the bag, empty where it is whole


def read_run_of(
    nominal: Nominal,
    bag: Path,
    *,
    reading: BagOptions | None = None,
    held_out: bool = False,
    take_damaged: bool = False,
) -> ReadRun:
    """Read a run on the soil of ``nominal``; a ``held_out`` one must be long enough to halve.

    A bag that ends in the middle or is damaged is used only where ``take_damaged``. Without
    ``reading`` the estimator's own topics and parameters apply.
    """
    lost = ""
    try:
        run, lost = _left_of(bag, nominal, reading or BagOptions(), take=take_damaged)
        if lost and not take_damaged:
            return ReadRun(None, f"{lost}; {TAKE_DAMAGED} uses what is left", lost)
        blocks = replace(_cut(run, nominal), soil=nominal.soil)
        return ReadRun(long_enough(blocks) if held_out else blocks, lost=lost)
    except (BagError, TopicError, RunError, OSError) as error:
        return ReadRun(None, str(error), lost)


def _cut(run: RecordedRun, nominal: Nominal) -> Blocks:
    if nominal.places is None:
        return cut(run, nominal.contact)
    known = nominal.contact.constants.unsqueeze(0)
    physics = physics_by_wheel(nominal.rover, nominal.places, known, 0.0)
    return cut_by_wheel(run, physics, nominal.row_names)


def _left_of(
    bag: Path, nominal: Nominal, reading: BagOptions, *, take: bool
) -> tuple[RecordedRun, str]:
    """Return the run of a bag and what is missing; of one that cannot be read what is recovered."""
    try:
        return _run_and_losses(bag, nominal.rover, reading, nominal.places)
    except BagError as error:
        if not take:
            raise
        with tempfile.TemporaryDirectory(prefix="recovered_") as folder:
            whole = Path(folder) / bag.name
            try:
                recovery = recover(bag, whole)
            except BagError:
                raise error from None
            if not recovery.span.count:
                raise
            run, _ = _run_and_losses(whole, nominal.rover, reading, nominal.places)
        return run, f"{error}; {recovery.words}"


def read_run(bag: Path, rover: Rover, reading: BagOptions) -> RecordedRun:
    """Read the run of a bag.

    Raises:
        BagError: it cannot be read.
        TopicError: a required topic is missing.
        RunError: no observation can be used; the message gives the reason.
    """
    return _run_and_losses(bag, rover, reading)[0]


def _run_and_losses(
    bag: Path, rover: Rover, reading: BagOptions, places: WheelPlaces | None = None
) -> tuple[RecordedRun, str]:
    names = reading.names
    with BagReader(bag) as reader:
        check_inputs(str(bag), reader.topics, names)
        reader.expect({names[name]: type_name for name, type_name in INPUT_TYPES.items()})
        refusals = Refusals()
        run = run_of(
            bag.name,
            _observations(reader, rover, reading, refusals, places),
            rover,
            reading.config.core.of_model(by_wheel=places is not None),
            refusals,
            SingleWheels.at(rover, places),
        )
        return run, "; ".join(reader.losses)


def _observations(
    reader: BagReader,
    rover: Rover,
    reading: BagOptions,
    refusals: Refusals,
    places: WheelPlaces | None,
) -> Iterator[Observation]:
    """Yield the observations of a bag at 10 Hz; RunError where no messages are of one instant."""
    by_wheel = places is not None
    used = reading.config.core.of_model(by_wheel=by_wheel)
    if not used.use_sinkage:
        raise RunError("parameter use_sinkage: the search needs every sinkage: set it to true")
    if used.contact_angle_sd:
        raise RunError(
            "parameter contact_angle_sd: the search needs every contact angle: set it to 0"
        )
    conversion = reading.config.conversion.of_model(by_wheel=by_wheel)
    converter = Converter(rover, conversion, used, places.steers(rover) if places else ())
    tracks = WheelTracks(rover, places, used.standstill_speed)
    none = True
    readings = (
        converter.convert(complete.stamp_ns, complete.messages)
        for complete in _paired(reader, reading, converter)
    )
    for converted in averaged(readings, Averager(rover, used, SingleWheels.at(rover, places))):
        none = False
        if converted.observation is None:
            refusals.add(converted.outcome, converted.detail)
            continue
        observation = tracks.undisturbed(converted.observation)
        if tracks.lacks:
            refusals.add(Outcome.NOT_FINITE, tracks.lacks)
        else:
            yield (observation if used.use_moments else replace(observation, bogie_angle=math.nan))
    if none:
        raise RunError(
            f"no {', '.join(REQUIRED_INPUTS)} have stamps within the parameter pairing_tolerance,"
            f" {reading.config.pairing.tolerance_s:g} s: give the estimator's value (-p or"
            " --params-file)"
        )


def _paired(reader: BagReader, reading: BagOptions, converter: Converter) -> Iterator[MessageSet]:
    synchronizer = input_synchronizer(INPUT_TYPES, reading.config.pairing)
    index = {reading.names[name]: (number, name) for number, name in enumerate(INPUT_TYPES)}
    for raw in reader.messages(index):
        (number, name), message = index[raw.topic], reader.decode(raw)
        # otherwise a mast or an arm would take the partners of the wheels
        if converter.concerns(name, message):
            yield from synchronizer.add(
                number, stamp_ns(message), message, getattr(message, "sequence", None)
            )
    yield from synchronizer.flush()
