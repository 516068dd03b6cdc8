# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the runs of a discovery from bags, by the estimator's own pairing and conversion."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from terrain_estimator.bags import BagReader
from terrain_estimator.cli.topics import check_inputs
from terrain_estimator.config import EstimatorConfig
from terrain_estimator.conversion import Converter
from terrain_estimator.discovery.runs import Run, run_of
from terrain_estimator.observation import Observation
from terrain_estimator.pairing import Synchronizer, Topic
from terrain_estimator.ros_types import INPUT_TYPES, REQUIRED_INPUTS, stamp_ns
from terramechanics.rover import Rover


def read_run(bag: Path, rover: Rover, config: EstimatorConfig, names: Mapping[str, str]) -> Run:
    """The run that ``bag`` holds; ``names`` are the topics' names in it, by the estimator's names.

    Raises:
        BagError: it cannot be read.
        TopicError: a required topic is missing.
        RunError: no observation can be used.
    """
    with BagReader(bag) as reader:
        check_inputs(str(bag), reader.topics, names)
        reader.expect({names[name]: type_name for name, type_name in INPUT_TYPES.items()})
        return run_of(bag.name, _observations(reader, rover, config, names), rover, config.core)


def _observations(reader: BagReader, rover: Rover, config: EstimatorConfig, names: Mapping[str, str]) -> Iterator[Observation]:
    topics = tuple(Topic(name, name in REQUIRED_INPUTS) for name in INPUT_TYPES)
    paired = Synchronizer(topics, round(config.pairing.tolerance_s * 1e9), round(config.pairing.timeout_s * 1e9))
    converter = Converter(rover, config.conversion, config.core)
    index = {names[name]: number for number, name in enumerate(INPUT_TYPES)}
    sets = (
        complete
        for raw in reader.messages(index)
        for message in [reader.decode(raw)]
        for complete in paired.add(index[raw.topic], stamp_ns(message), message, getattr(message, "sequence", None))
    )
    for complete in sets:
        observation = converter.convert(complete.stamp_ns, complete.messages).observation
        if observation is not None:
            yield observation
    for complete in paired.flush():
        observation = converter.convert(complete.stamp_ns, complete.messages).observation
        if observation is not None:
            yield observation
