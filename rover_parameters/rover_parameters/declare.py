# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Declare a node's parameters to ROS from their one definition, strictly."""

import sys
from collections.abc import Container, Sequence
from typing import Any, TypeVar, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from rover_parameters.files import DUMP, configured
from rover_parameters.parameters import Parameter, configure, effective, parameters, template
from rover_parameters.records import ConfigError

Config = TypeVar("Config")
SIM_TIME = "use_sim_time"


def given(node: Node) -> dict[str, Any]:
    """Return the values that the user gave, by parameter name, before any is declared."""
    return {
        name: cast("Any", entry).value for name, entry in node.get_parameters_by_prefix("").items()
    }


def declare(
    node: Node,
    config: type[Config],
    declared_elsewhere: Container[str] = (),
    *,
    changeable: bool = False,
    fixed: Container[str] = (),
    arguments: Sequence[str] | None = None,
) -> Config:
    """Read all parameters of a configuration and declare them.

    With ``--dump-config``, print them and end. ROS ignores a parameter that a node does not
    declare, and a parameter file without a section for the node; here both are errors. A list of
    strings is accepted for words separated by spaces.

    Args:
        node: made with ``automatically_declare_parameters_from_overrides=True``, which makes the
            user's values visible.
        config: made of fields by ``rover_parameters.records``.
        declared_elsewhere: given names that the node's subscriptions declare by themselves.
        changeable: the parameters can be set later, but for those in ``fixed``; the node judges
            each change and reads the values by :func:`in_force`. Otherwise all are read-only.
        fixed: names.
        arguments: of the node, if they are not those of the process.

    Raises:
        ConfigError: unknown name, wrong type, value out of range, or a parameter file that matches
            no node of this name.
        SystemExit: with code 0 after ``--dump-config``.
    """
    arguments = sys.argv if arguments is None else arguments
    values = given(node)
    name = node.get_fully_qualified_name()
    # rclpy reports a wrong type, then continues by the wall clock
    if type(clock := values.get(SIM_TIME, False)) is not bool:
        raise ConfigError(f"parameter {SIM_TIME}: expected true or false, got {clock!r}")
    elsewhere = [key for key in values if key in declared_elsewhere]
    result = configured(
        config,
        name,
        {key: value for key, value in values.items() if key not in elsewhere},
        arguments,
    )
    if DUMP in arguments:
        print(template(name, result))  # noqa: T201 - the user asked for it
        sys.exit()
    for key in elsewhere:
        node.undeclare_parameter(key)  # a subscription declares it anew, read-only
    values = effective(result)
    for entry in parameters(config):
        if node.has_parameter(entry.name):
            node.undeclare_parameter(entry.name)
        descriptor = _descriptor(entry)
        descriptor.read_only = not changeable or entry.name in fixed
        node.declare_parameter(entry.name, values[entry.name], descriptor, ignore_override=True)
    return result


def in_force(node: Node, config: type[Config]) -> Config:
    """Build the configuration from the values that the node's parameters have now.

    Raises:
        ConfigError: they do not fit together.
    """
    names = [entry.name for entry in parameters(config)]
    return configure(config, {name: node.get_parameter(name).value for name in names})


def _descriptor(entry: Parameter) -> ParameterDescriptor:
    """Return the descriptor, with the range in words and, where ROS can hold it, as numbers."""
    descriptor = ParameterDescriptor(description=entry.meaning, additional_constraints=entry.limits)
    if entry.range and isinstance(entry.default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=entry.low, to_value=entry.high)
        ]
    elif entry.range:
        descriptor.integer_range = [
            IntegerRange(from_value=int(entry.low), to_value=int(entry.high))
        ]
    return descriptor
