# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Declares the fields of a configuration as ROS parameters, with descriptors and ranges."""

import sys
from typing import Any, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from rover_sim_node.config import SimulatorConfig
from terramechanics.parameter_files import DUMP, configured
from terramechanics.parameters import Parameter, effective, parameters, template


def declare(node: Node) -> SimulatorConfig:
    """Read and declare every parameter, read-only; print them and end after ``--dump-config``.

    The node must declare its overrides by itself, or misspelt names are not seen.

    Raises:
        ConfigError: unknown name, wrong type, value out of range, or a parameter file that matches no node of this name.
        SystemExit: with code 0 after ``--dump-config``.
    """
    given = {name: cast("Any", entry).value for name, entry in node.get_parameters_by_prefix("").items()}
    name = node.get_fully_qualified_name()
    config = configured(SimulatorConfig, name, given, sys.argv)
    if DUMP in sys.argv:
        print(template(name, config))  # noqa: T201 - the user asked for it
        sys.exit()
    values = effective(config)
    for entry in parameters(SimulatorConfig):
        if node.has_parameter(entry.name):
            node.undeclare_parameter(entry.name)
        node.declare_parameter(entry.name, values[entry.name], _descriptor(entry), ignore_override=True)
    return config


def _descriptor(entry: Parameter) -> ParameterDescriptor:
    """Where ROS cannot hold the range the words say it."""
    descriptor = ParameterDescriptor(description=entry.meaning, additional_constraints=entry.limits, read_only=True)
    if entry.range and isinstance(entry.default, float):
        descriptor.floating_point_range = [FloatingPointRange(from_value=entry.low, to_value=entry.high)]
    elif entry.range:
        descriptor.integer_range = [IntegerRange(from_value=int(entry.low), to_value=int(entry.high))]
    return descriptor
