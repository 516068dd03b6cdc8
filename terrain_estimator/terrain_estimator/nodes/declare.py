# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Declares a node's parameters from their one definition, strictly."""

import math
from typing import Any, TypeVar, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from terrain_estimator.parameters import Parameter, build, definitions, effective

Config = TypeVar("Config")
_OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare(node: Node, config: type[Config]) -> Config:
    """Read and declare all parameters of a configuration, read-only.

    ROS passes over a parameter that a node does not declare; here a misspelt name is an error. A list of strings is
    taken where words separated by spaces are meant.

    Args:
        node: made with ``automatically_declare_parameters_from_overrides=True``, or what a user gave is not seen.
        config: made of fields by ``parameters.parameter``.

    Raises:
        ParameterError: unknown name, wrong type or value out of range.
    """
    given = {name: cast("Any", entry).value for name, entry in node.get_parameters_by_prefix("").items() if not name.startswith(_OF_ROS)}
    result = build(config, {name: _words(value) for name, value in given.items()})
    values = effective(result)
    for entry in definitions(config):
        if node.has_parameter(entry.name):
            node.undeclare_parameter(entry.name)
        node.declare_parameter(entry.name, values[entry.name], _descriptor(entry), ignore_override=True)
    return result


def _words(value: object) -> object:
    return " ".join(value) if isinstance(value, list) and all(isinstance(word, str) for word in value) else value


def _descriptor(entry: Parameter) -> ParameterDescriptor:
    unit = f" [{entry.unit}]" if entry.unit else ""
    descriptor = ParameterDescriptor(description=f"{entry.description}{unit}", additional_constraints=entry.constraints, read_only=True)
    if math.isfinite(entry.minimum) and math.isfinite(entry.maximum):
        if isinstance(entry.default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=entry.minimum, to_value=entry.maximum)]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(entry.minimum), to_value=int(entry.maximum))]
    return descriptor
