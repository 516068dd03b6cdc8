# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run one bag through the estimator at full speed: the node's pipeline without the node."""

import gc
import hashlib
import itertools
import json
import math
import time
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Self

from rover_parameters.parameters import effective
from terrain_estimator.bags import (
    BagError,
    BagReader,
    BagWriter,
    Message,
    RawMessage,
    Types,
    bag_name,
    compare,
    is_sequenced,
    sequence_of,
    whole_bag,
)
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.estimator.saved_state import Arrays
from terrain_estimator.messaging.averaging import RateCounts
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.health import RefusalCounts
from terrain_estimator.messaging.history import RunHistory, WheelHistory
from terrain_estimator.messaging.messages import status_of
from terrain_estimator.messaging.pairing import Counters, MessageSet
from terrain_estimator.messaging.pipeline import Answer, Pipeline, rover_of
from terrain_estimator.messaging.sequence_numbers import Sequences
from terrain_estimator.messaging.settled import SettledOutcomes
from terrain_estimator.model.model_file import LoadedModel
from terrain_estimator.offline.estimation_process import Answered, Converted, answering
from terrain_estimator.offline.state_files import read_state
from terrain_estimator.offline.topic_mapping import check_inputs
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES
from terrain_estimator.update import Disagreement

TRUTH = "ground_truth/terrain"
BATCH = 500  # messages


class Start(NamedTuple):
    """A saved state that a replay starts from."""

    path: Path
    arrays: Arrays
    sha256: str  # of its file

    @classmethod
    def read(cls, path: Path, model_sha256: str) -> Self:
        """Read a state file. Raises StateFileError."""
        arrays = read_state(path, model_sha256)
        return cls(path, arrays, hashlib.sha256(path.read_bytes()).hexdigest())


@dataclass(slots=True)
class Replay:
    """Result of the replay of one bag."""

    bag: Path
    estimates_bag: Path
    name: str = ""  # of the run; empty: that of the bag
    state_sha256: str = ""  # of the file of the state that it started from
    missing_s: float | None = 0.0  # at the end of an unfinished bag; None where it is unknown
    notes: list[str] = field(default_factory=list)
    wall_s: float = 0.0  # of reading, estimating and writing, without loading anything
    estimates: int = 0
    inputs: dict[str, Counters] = field(default_factory=dict)
    # of msg_defs messages apart from the inputs, by topic of the bag
    sequences: Sequences = field(default_factory=Sequences)
    first: Answer | None = None
    last: Answer | None = None
    status: str = ""
    # grows only with the changes of the simulated ground
    truths: list[Message] = field(default_factory=list)
    history: RunHistory = field(default_factory=RunHistory)
    slip: WheelHistory = field(default_factory=WheelHistory)
    sinkage: WheelHistory = field(default_factory=WheelHistory)
    rates: RateCounts = field(default_factory=RateCounts)
    refusals: RefusalCounts = field(default_factory=RefusalCounts)
    # by topic, empty where identical to live; None where not compared
    differences: dict[str, str] | None = None

    def __post_init__(self) -> None:
        """Name the run by its bag where it has no name of its own."""
        self.name = self.name or bag_name(self.bag)

    def keep_wheels(self, complete: MessageSet) -> None:
        """Record the wheels' measurements of one instant."""
        slip, sinkage, *_ = complete.messages
        self.slip.add(complete.stamp_ns, slip.wheel, slip.slip)
        self.sinkage.add(complete.stamp_ns, sinkage.wheel, sinkage.sinkage)

    @property
    def settled(self) -> SettledOutcomes:
        """Observations and seconds by what became of them."""
        return self.history.settled

    @property
    def learnt(self) -> bool:
        """Return whether an observation was used; otherwise the last estimate is the prior."""
        return self.settled.used > 0

    @property
    def disagreements(self) -> tuple[Disagreement, ...]:
        """Reasons why the model does not fit at the end, for which the prior is published."""
        return self.last.update.disagreements if self.last else ()

    @property
    def gave_estimate(self) -> bool:
        """Return whether the last estimate is one: something was learnt, by a model that fits."""
        return self.learnt and not self.disagreements

    @property
    def truth(self) -> Message | None:
        """Last true ground; None where the bag has none."""
        return self.truths[-1] if self.truths else None

    @property
    def span_s(self) -> float:
        """Time [s] between the stamps of the first and the last estimate."""
        return (
            (self.last.update.stamp_ns - self.first.update.stamp_ns) / 1e9
            if self.first and self.last
            else 0.0
        )

    @property
    def times_real_time(self) -> float:
        """Speed of the replay relative to the recording."""
        return self.span_s / self.wall_s if self.wall_s > 0.0 else math.nan


class _Output:
    """Writer of the outgoing messages of each answer."""

    def __init__(self, writer: BagWriter, pipeline: Pipeline, names: Mapping[str, str]) -> None:
        self._writer, self._pipeline, self._types = writer, pipeline, Types()
        for type_name in OUTPUT_TYPES.values():
            self._types.make(type_name)  # the first message of a type takes some milliseconds
        self._topics = {
            name: writer.add_topic(names[name], type_name)
            for name, type_name in OUTPUT_TYPES.items()
        }

    def write(self, answers: Answered) -> None:
        """Write answers with the log times of the messages that completed their sets.

        Both bags can then be played side by side.
        """
        made = [
            (cause, answer.messages(self._types.make, self._pipeline.meta))
            for cause, answer in answers
        ]
        for cause, messages in made:
            for name, message in messages.items():
                self._writer.write(
                    self._topics[name],
                    self._types.serialize(message),
                    cause.log_time_ns,
                    cause.publish_time_ns,
                )


def replay(
    bag: Path,
    output: Path,
    model: LoadedModel,
    config: EstimatorConfig,
    names: Mapping[str, str],
    start: Start | None = None,
) -> Replay:
    """Estimate from the messages of ``bag`` and write the estimates to the new bag ``output``.

    ``names`` are the topic names in the bag, by the estimator's names. Without ``start`` the
    estimator starts from the prior.

    Raises:
        StateFileError: ``start`` is no state of this model.
        BagError: the bag cannot be read, a type is wrong, or the output cannot be written; the
            output is then removed.
        TopicError: a required topic is missing.
    """
    result = Replay(bag, output)
    with BagReader(bag) as reader:
        check_inputs(str(bag), reader.topics, names)
        reader.expect({names[name]: type_name for name, type_name in INPUT_TYPES.items()})
        result.missing_s = reader.missing_s
        result.notes = reader.notes + _other_model(reader, model, names["terrain_estimate"])
        wheels = rover_of(model, config.rover).wheel_names
        result.slip, result.sinkage = WheelHistory(wheels), WheelHistory(wheels)
        pipeline = Pipeline(model, config)
        if start:
            pipeline.restore(start.arrays, str(start.path))
            result.state_sha256 = start.sha256
        origin = identity(pipeline, config) | ({"state_sha256": start.sha256} if start else {})
        _estimate(reader, pipeline, origin, names, result)
    return result


def _estimate(
    reader: BagReader,
    pipeline: Pipeline,
    origin: dict[str, str],
    names: Mapping[str, str],
    result: Replay,
) -> None:
    """Write the estimates bag, with ``origin`` as its metadata, and complete the result."""
    for name in names.values():
        if name in reader.topics:
            reader.prepare(name)
    with whole_bag(result.estimates_bag) as writer:
        writer.add_metadata("terrain_estimator", origin)
        output = _Output(writer, pipeline, names)
        gc.collect()
        gc.freeze()  # collections over torch's modules would take a tenth of the time
        started_s = time.perf_counter()
        _run(reader, pipeline, output, names, result)
    result.wall_s = time.perf_counter() - started_s
    result.inputs = dict(pipeline.counters)
    if result.last:
        result.status = status_of(result.last.update, pipeline.meta.rows).name


def _other_model(reader: BagReader, model: LoadedModel, estimates: str) -> list[str]:
    """Return a note where the node's ``estimates`` in the bag are from another model."""
    node = reader.metadata.get("terrain_estimator", {})
    ours = node.get("topic", "").rpartition("/")[0] == estimates.rpartition("/")[0]
    live = node.get("model_id", "") if ours else ""
    words = (
        f"{reader.path}: its live estimates are of model {live}, those of this replay of"
        f" {model.model_id} (--model)"
    )
    return [words] if live not in {"", model.model_id} else []


def identity(pipeline: Pipeline, config: EstimatorConfig) -> dict[str, str]:
    """Return the model and the full configuration that estimates depend on."""
    meta = pipeline.meta
    names = {
        "model_id": meta.model_id,
        "model_sha256": meta.model_sha256,
        "configuration_sha256": meta.configuration_sha256,
    }
    return names | {"configuration": json.dumps(effective(config))}


def _run(
    reader: BagReader, pipeline: Pipeline, output: _Output, names: Mapping[str, str], result: Replay
) -> None:
    """Read, pair, convert, estimate and write: each step for a batch of messages, which is faster.

    The answers are the same: every step keeps the order, and no step depends on a later one.
    """
    with answering(pipeline) as answered, ProgressReport(f"replay {result.name}") as progress:
        for answers in answered(_converted(reader, pipeline, names, result, progress)):
            _keep(answers, output, result)


def _converted(
    reader: BagReader,
    pipeline: Pipeline,
    names: Mapping[str, str],
    result: Replay,
    progress: ProgressReport,
) -> Iterator[Converted]:
    """Yield the sets of the bag in batches, each with the message that completed it.

    Sets that still wait at the end of the bag come last.
    """
    ours = {names[name]: name for name in (*pipeline.inputs, TRUTH)}
    span = reader.span
    cause: RawMessage | None = None

    def readings(complete: MessageSet) -> list[Conversion]:
        result.keep_wheels(complete)
        taken = pipeline.average(pipeline.convert(complete))
        result.rates.add(pipeline.rate)
        return taken

    messages = _counted(reader, ours, {names[name] for name in pipeline.inputs}, result.sequences)
    while batch := list(itertools.islice(messages, BATCH)):
        progress.at((batch[0].log_time_ns - span.first_ns) / max(1, span.duration_ns))
        decoded = [(raw, ours[raw.topic], reader.decode(raw)) for raw in batch]
        for _, name, message in decoded:
            if name == TRUTH:
                result.truths.append(message)
        inputs = [(raw, name, message) for raw, name, message in decoded if name != TRUTH]
        sets = [
            (raw, complete)
            for raw, name, message in inputs
            for complete in pipeline.pair(name, message)
        ]
        yield [(raw, taken) for raw, complete in sets for taken in readings(complete)]
        cause = inputs[-1][0] if inputs else cause
    if cause is not None:
        last = [taken for complete in pipeline.rest() for taken in readings(complete)]
        yield [(cause, taken) for taken in (*last, *pipeline.rest_of_means())]


def _counted(
    reader: BagReader, wanted: Container[str], paired: Container[str], sequences: Sequences
) -> Iterator[RawMessage]:
    """Yield the wanted messages, and count gaps in all msg_defs messages.

    Pairing counts the gaps of the inputs.
    """
    counted = {
        name
        for name, topic in reader.topics.items()
        if name not in paired and is_sequenced(topic.definition)
    }
    for raw in reader.messages(
        [name for name in reader.topics if name in wanted or name in counted]
    ):
        if raw.topic in counted and (sequence := sequence_of(raw.data)) is not None:
            sequences.note(raw.topic, sequence)
        if raw.topic in wanted:
            yield raw


def _keep(answers: Answered, output: _Output, result: Replay) -> None:
    output.write(answers)
    for _, answer in answers:
        result.estimates += 1
        result.refusals.add(answer.update.decision)
        result.history.add(answer.update)
    if answers:
        result.first = result.first or answers[0][1]
        result.last = answers[-1][1]


def compare_with_live(result: Replay, names: Mapping[str, str]) -> None:
    """Compare the estimates with those of the live node in the bag, byte by byte.

    Raises:
        BagError: the bag has none.
    """
    with BagReader(result.bag) as reader:
        if missing := [names[name] for name in OUTPUT_TYPES if names[name] not in reader.topics]:
            raise BagError(
                f"{result.bag} has no {missing[0]} to compare with: leave out --compare, or record"
                " the live estimator"
            )
    pairs = {
        name: compare(result.bag, names[name], result.estimates_bag, names[name])
        for name in OUTPUT_TYPES
    }
    result.differences = {
        name: "" if difference is None else str(difference) for name, difference in pairs.items()
    }
