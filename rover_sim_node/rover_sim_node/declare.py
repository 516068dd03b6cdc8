# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Declares the fields of a configuration as ROS parameters, with descriptors and ranges."""

import math
from typing import Any, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from rover_sim_node.config import leaves

OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Parameters that every node has."""


def given_parameters(node: Node) -> dict[str, Any]:
    """What the user gave, by flat name. The node must declare its overrides by itself, or misspelt names are not seen."""
    found = cast("dict[str, Any]", node.get_parameters_by_prefix(""))
    return {name: parameter.value for name, parameter in found.items() if not name.startswith(OF_ROS)}


def declare(node: Node, config: object) -> None:
    """Declare every field of ``config`` with its value in force: read-only, described, with its range."""
    for name, value, metadata in leaves(config):
        if node.has_parameter(name):
            node.undeclare_parameter(name)
        node.declare_parameter(name, value, _descriptor(value, metadata), ignore_override=True)


def _descriptor(value: object, metadata: Any) -> ParameterDescriptor:  # noqa: ANN401 (a mapping of unlike things)
    unit = f" [{metadata['unit']}]" if "unit" in metadata else ""
    descriptor = ParameterDescriptor(description=f"{metadata['description']}{unit}", read_only=True)
    low, high = metadata.get("low", -math.inf), metadata.get("high", math.inf)
    if isinstance(value, bool | str) or (isinstance(value, float) and math.isnan(value)):
        return descriptor
    # ROS ranges need both ends; where one is missing the words say it.
    if math.isinf(low) or math.isinf(high):
        descriptor.additional_constraints = "" if math.isinf(low) else f"{'above' if metadata['exclusive'] else 'at least'} {low:g}"
    elif isinstance(value, int):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    else:
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor
