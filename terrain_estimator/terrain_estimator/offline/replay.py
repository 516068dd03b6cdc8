# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run one bag through the estimator at full speed: the node's pipeline without the node."""

import dataclasses
import gc
import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple, Self, TypeAlias

from rover_parameters.parameters import effective
from terrain_estimator.bags import (
    BagError,
    BagReader,
    BagWriter,
    Packer,
    Types,
    compare,
    whole_bag,
)
from terrain_estimator.compiled.finding import Chosen, load
from terrain_estimator.config.estimator import AUTO, COMPILED, TORCHSCRIPT, EstimatorConfig
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.estimator.saved_state import Arrays
from terrain_estimator.messaging.history import WheelHistory
from terrain_estimator.messaging.messages import status_of, status_text
from terrain_estimator.messaging.pipeline import Pipeline, configuration_sha256, rover_of
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.offline.converted import converted
from terrain_estimator.offline.estimation_process import Answered, answering
from terrain_estimator.offline.replay_result import Replay
from terrain_estimator.offline.state_files import read_state
from terrain_estimator.offline.topic_mapping import check_inputs, perhaps_renamed
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES

Keep: TypeAlias = Callable[[Answered], None]
"""A function that keeps a batch of answers."""

Into: TypeAlias = Callable[[Pipeline, dict[str, str]], AbstractContextManager[Keep]]
"""A place for the answers of a pipeline, by :func:`identity`: open while they come."""


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


class _Output:
    """Writer of the outgoing messages of each answer."""

    def __init__(self, writer: BagWriter, pipeline: Pipeline, names: Mapping[str, str]) -> None:
        self._writer, self._pipeline = writer, pipeline
        self._packer = Packer(Types(), *OUTPUT_TYPES.values())
        self._topics = {
            name: writer.add_topic(names[name], type_name)
            for name, type_name in OUTPUT_TYPES.items()
        }

    def write(self, answers: Answered) -> None:
        """Write answers with the log times of the messages that completed their sets.

        Both bags can then be played side by side.
        """
        make, pack, meta = self._packer.make, self._packer.pack, self._pipeline.meta
        packed = [
            (cause, name, pack(draft))
            for cause, answer in answers
            for name, draft in answer.messages(make, meta).items()
        ]
        for cause, name, data in packed:
            self._writer.write(self._topics[name], data, cause.log_time_ns, cause.publish_time_ns)


def replay(
    bag: Path,
    output: Path,
    chosen: Chosen,
    config: EstimatorConfig,
    names: Mapping[str, str],
    start: Start | None = None,
) -> Replay:
    """Estimate from the messages of ``bag`` and write the estimates to the new bag ``output``.

    ``chosen`` is the model for ``config``. ``names`` are the topic names in the bag, by the
    estimator's names. Without ``start`` the estimator starts from the prior.

    Raises:
        StateFileError: ``start`` is no state of this model.
        BagError: the bag cannot be read, a type is wrong, or the output cannot be written; the
            output is then removed.
        TopicError: a required topic is missing.
    """
    result = estimate(bag, partial(_written, output, names), chosen, config, names, start)
    result.estimates_bag = output
    return result


def estimate(
    bag: Path,
    into: Into,
    chosen: Chosen,
    config: EstimatorConfig,
    names: Mapping[str, str],
    start: Start | None = None,
    *,
    silent: bool = False,
) -> Replay:
    """Estimate as :func:`replay` does, and give the answers to ``into``; raises the same errors."""
    result = Replay(bag)
    with BagReader(bag) as reader:
        check_inputs(str(bag), reader.topics, names)
        reader.expect({names[name]: type_name for name, type_name in INPUT_TYPES.items()})
        types = {name: topic.type_name for name, topic in reader.topics.items()}
        result.missing_s = reader.missing_s
        result.notes = [
            *reader.notes,
            *perhaps_renamed(str(bag), types, names),
            *_other_model(reader, chosen.model, names["terrain_estimate"]),
        ]
        wheels = rover_of(chosen.model.metadata, config.rover).wheel_names
        result.slip, result.sinkage = WheelHistory(wheels), WheelHistory(wheels)
        chosen = _as_recorded(reader, chosen, config, names["terrain_estimate"])
        result.runtime = chosen.runtime
        result.notes += [chosen.why] if chosen.why else []
        config = dataclasses.replace(config, runtime=chosen.runtime)
        pipeline = Pipeline(chosen.model, config)
        if start:
            pipeline.restore(start.arrays, str(start.path))
            result.state_sha256 = start.sha256
        result.configuration_sha256 = pipeline.meta.configuration_sha256
        for name in names.values():
            if name in reader.topics:
                reader.prepare(name)
        origin = identity(pipeline, config) | ({"state_sha256": start.sha256} if start else {})
        with into(pipeline, origin) as keep, _few_collections():
            started_s = time.perf_counter()
            _run(reader, pipeline, keep, names, result, silent=silent)
        result.wall_s = time.perf_counter() - started_s
        result.inputs = dict(pipeline.counters)
        if result.last:
            update, rows = result.last.update, pipeline.meta.rows
            status = status_of(update, rows)
            result.status = status.name
            result.status_text = status_text(update, status, rows, result.last.notes)
    return result


@contextmanager
def _written(
    path: Path, names: Mapping[str, str], pipeline: Pipeline, origin: dict[str, str]
) -> Iterator[Keep]:
    """Write the answers to a new bag, with ``origin`` as its metadata."""
    with whole_bag(path) as writer:
        writer.add_metadata("terrain_estimator", origin)
        yield _Output(writer, pipeline, names).write


@contextmanager
def _few_collections() -> Iterator[None]:
    """Keep the garbage collector from torch's modules, which would take a tenth of the time."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def _as_recorded(
    reader: BagReader, chosen: Chosen, config: EstimatorConfig, estimates: str
) -> Chosen:
    """Return the model for ``config`` with the runtime of the bag's ``estimates`` where it has any.

    Where their runtime is the compiled core and this machine has none, bytes cannot be compared,
    which is said.
    """
    if config.runtime != AUTO:
        return chosen
    live = _live_configuration(reader, estimates)
    of = {
        name: configuration_sha256(chosen.model, dataclasses.replace(config, runtime=name))
        for name in (COMPILED, TORCHSCRIPT)
    }
    if live == of[TORCHSCRIPT] and chosen.runtime != TORCHSCRIPT:
        return load(config.model, TORCHSCRIPT)
    if live == of[COMPILED] and chosen.runtime != COMPILED:
        words = (
            f"{reader.path}: its live estimates are of the compiled core; this replay runs"
            f" TorchScript, whose bytes differ: {chosen.why}"
        )
        return chosen._replace(why=words)
    return chosen._replace(why="")


def _live_configuration(reader: BagReader, estimates: str) -> str:
    """Return the SHA-256 of the configuration behind the bag's estimates; empty if it has none."""
    if estimates not in reader.topics:
        return ""
    first = next(iter(reader.messages([estimates])), None)
    if first is None:
        return _live_node(reader, estimates).get("configuration_sha256", "")
    return str(reader.decode(first).configuration_sha256)


def _live_node(reader: BagReader, estimates: str) -> Mapping[str, str]:
    """Return what the recorder wrote of the node that gave ``estimates``; empty if nothing."""
    node: Mapping[str, str] = reader.metadata.get("terrain_estimator", {})
    ours = node.get("topic", "").rpartition("/")[0] == estimates.rpartition("/")[0]
    return node if ours else {}


def _other_model(reader: BagReader, model: LoadedModel, estimates: str) -> list[str]:
    """Return a note where the node's ``estimates`` in the bag are from another model."""
    live = _live_node(reader, estimates).get("model_id", "")
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
    reader: BagReader,
    pipeline: Pipeline,
    keep: Keep,
    names: Mapping[str, str],
    result: Replay,
    *,
    silent: bool,
) -> None:
    """Read, pair, convert, estimate and keep: each step for a batch of messages, which is faster.

    The answers are the same: every step keeps the order, and no step depends on a later one.
    """
    title = f"replay {result.name}"
    with answering(pipeline) as answered, ProgressReport(title, silent=silent) as progress:
        for answers in answered(converted(reader, pipeline, names, result, progress)):
            keep(answers)
            _count(answers, result)


def _count(answers: Answered, result: Replay) -> None:
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
