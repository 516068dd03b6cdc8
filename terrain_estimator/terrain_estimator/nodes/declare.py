# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Declares a node's parameters from their one definition, strictly."""

import sys
from collections.abc import Iterable
from typing import Any, TypeVar, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from terrain_estimator.nodes.quality import check_overrides
from terramechanics.loading import ConfigError
from terramechanics.parameter_files import DUMP, OVERRIDES, configured
from terramechanics.parameters import Parameter, effective, parameters, template

Config = TypeVar("Config")
SIM_TIME = "use_sim_time"


def declare(node: Node, config: type[Config], topics: Iterable[str] = ()) -> Config:
    """Read and declare all parameters of a configuration, read-only; print them and end after ``--dump-config``.

    ROS passes over a parameter that a node does not declare, and over a parameter file that has nothing for the node; here a
    misspelt name is an error. A list of strings is taken where words separated by spaces are meant.

    Args:
        node: made with ``automatically_declare_parameters_from_overrides=True``, or what a user gave is not seen.
        config: made of fields by ``terramechanics.loading``.
        topics: whose subscriptions' quality of service a user may override; the subscriptions declare those parameters.

    Raises:
        ConfigError: unknown name, wrong type, value out of range, or a parameter file that matches no node of this name.
        SystemExit: with code 0 after ``--dump-config``.
    """
    given = {name: cast("Any", entry).value for name, entry in node.get_parameters_by_prefix("").items()}
    name = node.get_fully_qualified_name()
    overrides = {key: value for key, value in given.items() if key.startswith(OVERRIDES)}
    check_overrides(overrides, map(node.resolve_topic_name, topics))
    if type(clock := given.get(SIM_TIME, False)) is not bool:
        raise ConfigError(f"parameter {SIM_TIME}: expected true or false, got {clock!r}")  # rclpy says so, and goes on by the wall clock
    result = configured(config, name, {key: value for key, value in given.items() if key not in overrides}, sys.argv)
    if DUMP in sys.argv:
        print(template(name, result))  # noqa: T201 - the user asked for it
        sys.exit()
    for key in overrides:
        node.undeclare_parameter(key)  # a subscription declares it anew, read-only
    values = effective(result)
    for entry in parameters(config):
        if node.has_parameter(entry.name):
            node.undeclare_parameter(entry.name)
        node.declare_parameter(entry.name, values[entry.name], _descriptor(entry), ignore_override=True)
    return result


def _descriptor(entry: Parameter) -> ParameterDescriptor:
    """Where ROS cannot hold the range the words say it."""
    descriptor = ParameterDescriptor(description=entry.meaning, additional_constraints=entry.limits, read_only=True)
    if entry.range and isinstance(entry.default, float):
        descriptor.floating_point_range = [FloatingPointRange(from_value=entry.low, to_value=entry.high)]
    elif entry.range:
        descriptor.integer_range = [IntegerRange(from_value=int(entry.low), to_value=int(entry.high))]
    return descriptor
