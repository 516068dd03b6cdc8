# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Options to find and read the messages of bags, shared by all commands that take bags."""

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from rover_parameters.files import parse_assignment, read_parameters
from rover_parameters.parameters import configure
from terrain_estimator.config.estimator import EstimatorConfig, EstimatorNodeConfig
from terrain_estimator.offline.topic_mapping import absolute, bag_topics


@dataclass(frozen=True, slots=True)
class BagOptions:
    """Topic names in the bag, by the estimator's names, and the estimator's parameters."""

    names: dict[str, str] = field(default_factory=lambda: bag_topics([], ""))
    config: EstimatorConfig = field(default_factory=EstimatorConfig)


ConfigT = TypeVar("ConfigT")


def add_parameters(parser: ArgumentParser) -> None:
    """Add the options that :func:`parameters_of` reads."""
    parser.add_argument(
        "--params-file",
        type=Path,
        action="append",
        default=[],
        help="parameters as the node takes them; later files win",
    )
    parser.add_argument(
        "-p",
        "--param",
        action="append",
        default=[],
        metavar="NAME:=VALUE",
        help="one parameter; wins over the files",
    )
    parser.add_argument(
        "--namespace", default="", help="namespace of the topics in the bag, such as /rover1"
    )


def add_options(parser: ArgumentParser) -> None:
    """Add the options that :func:`node_config` and :func:`reading_of` read."""
    add_parameters(parser)
    parser.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="FROM:=TO",
        help="another name of a topic, such as wheel_slip:=/slip",
    )


def parameters_of(options: Namespace, node: str, kind: type[ConfigT], **more: Any) -> ConfigT:
    """Return a node's parameters from files and single options; ``more`` overrides both.

    Raises ConfigError.
    """
    values: dict[str, Any] = {}
    for path in options.params_file:
        values |= read_parameters(path, absolute(node, options.namespace))
    return configure(kind, values | dict(parse_assignment(text) for text in options.param) | more)


def node_config(options: Namespace, **more: Any) -> EstimatorNodeConfig:
    """Return the parameters of the estimator node; ``more`` overrides the options."""
    return parameters_of(options, "estimator", EstimatorNodeConfig, **more)


def reading_of(options: Namespace) -> BagOptions:
    """Return the topics and parameters that the options name.

    Raises ConfigError and TopicError.
    """
    return BagOptions(bag_topics(options.remap, options.namespace), node_config(options).estimator)
