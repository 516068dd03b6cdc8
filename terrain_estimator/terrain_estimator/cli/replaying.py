# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Runs one bag through the estimator, as fast as it goes: the node's pipeline without the node."""

import gc
import math
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from terrain_estimator.bags import BagReader, BagWriter, Message, RawMessage, Types, compare
from terrain_estimator.cli.progress import ProgressReport
from terrain_estimator.cli.topics import check_inputs
from terrain_estimator.config import EstimatorConfig
from terrain_estimator.messages import status_of
from terrain_estimator.model_file import LoadedModel
from terrain_estimator.outcome import Outcome
from terrain_estimator.pairing import Counters
from terrain_estimator.pipeline import Answer, Pipeline
from terrain_estimator.ros_types import INPUT_TYPES, OUTPUT_TYPES

TRUTH = "ground_truth/terrain"
_PROGRESS_EVERY = 250  # messages


@dataclass(slots=True)
class Replay:
    """What came of one bag."""

    bag: Path
    estimates_bag: Path
    span_s: float = 0.0  # of the stamps of the estimates
    missing_s: float | None = 0.0  # at the end of an unfinished bag; None where nothing tells
    notes: list[str] = field(default_factory=list)
    wall_s: float = 0.0  # reading, estimating and writing; without loading program, model and message definitions
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    inputs: dict[str, Counters] = field(default_factory=dict)
    last: Answer | None = None
    status: str = ""
    truth: Message | None = None
    differences: dict[str, str] | None = None  # by topic, empty where it is identical to live; None where not compared

    @property
    def estimates(self) -> int:
        """Number of estimates."""
        return self.outcomes.total()

    @property
    def times_real_time(self) -> float:
        """How much faster than the recording it went."""
        return self.span_s / self.wall_s if self.wall_s > 0.0 else math.nan


class _Output:
    """Writes the outgoing messages of each answer."""

    def __init__(self, writer: BagWriter, pipeline: Pipeline, names: Mapping[str, str]) -> None:
        self._writer, self._pipeline, self._types = writer, pipeline, Types()
        for type_name in OUTPUT_TYPES.values():
            self._types.make(type_name)  # the first of a type takes some ms
        self._topics = {name: writer.add_topic(names[name], type_name) for name, type_name in OUTPUT_TYPES.items()}

    def write(self, answer: Answer, cause: RawMessage) -> None:
        """Log times are those of the message that completed the set, so that both bags play side by side."""
        for name, message in answer.messages(self._types.make, self._pipeline.meta).items():
            self._writer.write(self._topics[name], self._types.serialize(message), cause.log_time_ns, cause.publish_time_ns)


def replay(bag: Path, output: Path, model: LoadedModel, config: EstimatorConfig, names: Mapping[str, str]) -> Replay:
    """Estimate from the messages of ``bag`` and write the estimates to the new bag ``output``.

    ``names`` are the topics' names in the bag, by the estimator's names.

    Raises:
        BagError: the bag cannot be read, a type is another, or the output cannot be written.
        TopicError: a required topic is missing.
    """
    result = Replay(bag, output)
    with BagReader(bag) as reader:
        check_inputs(str(bag), reader.topics, names)
        reader.expect({names[name]: type_name for name, type_name in INPUT_TYPES.items()})
        result.missing_s, result.notes = reader.missing_s, reader.notes
        pipeline = Pipeline(model, config)
        for name in names.values():
            if name in reader.topics:
                reader.prepare(name)
        with BagWriter(output) as writer:
            outgoing = _Output(writer, pipeline, names)
            gc.collect()
            gc.freeze()  # collections over torch's modules would take a tenth of the time
            started_s = time.perf_counter()
            _run(reader, pipeline, outgoing, names, result)
        result.wall_s = time.perf_counter() - started_s
        result.inputs = dict(pipeline.counters)
        if result.last:
            result.status = status_of(result.last.update, pipeline.meta.rows).name
    return result


def _run(reader: BagReader, pipeline: Pipeline, output: _Output, names: Mapping[str, str], result: Replay) -> None:
    ours = {names[name]: name for name in (*pipeline.inputs, TRUTH)}
    span = reader.span
    first_ns, cause = None, None
    with ProgressReport(f"replay {result.bag.name}") as progress:
        for count, raw in enumerate(reader.messages(ours)):
            if count % _PROGRESS_EVERY == 0:
                progress.at((raw.log_time_ns - span.first_ns) / max(1, span.duration_ns))
            message = reader.decode(raw)
            name = ours[raw.topic]
            if name == TRUTH:
                result.truth = message
                continue
            cause = raw
            for answer in pipeline.add(name, message):
                first_ns = answer.update.stamp_ns if first_ns is None else first_ns
                _keep(answer, raw, output, result)
    if cause is not None:
        for answer in pipeline.flush():
            _keep(answer, cause, output, result)
    if result.last is not None and first_ns is not None:
        result.span_s = (result.last.update.stamp_ns - first_ns) / 1e9


def _keep(answer: Answer, cause: RawMessage, output: _Output, result: Replay) -> None:
    output.write(answer, cause)
    result.outcomes[answer.update.decision.outcome] += 1
    result.last = answer


def compare_with_live(result: Replay, names: Mapping[str, str]) -> None:
    """Compare the estimates with those that the bag has from the live node, byte by byte.

    Raises:
        BagError: the bag has none.
    """
    pairs = {name: compare(result.bag, names[name], result.estimates_bag, names[name]) for name in OUTPUT_TYPES}
    result.differences = {name: "" if difference is None else str(difference) for name, difference in pairs.items()}
