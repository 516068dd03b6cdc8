# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Subscribe with a quality of service that a user may override.

The override is ROS's own: ``qos_overrides./imu.subscription.reliability: best_effort``.
"""

import copy
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from rover_parameters.files import OVERRIDES
from rover_parameters.records import ConfigError, nearest
from terrain_estimator.nodes.common.message_types import message_class

MAX_DEPTH = 10_000  # messages
RELIABILITY = ("reliable", "best_effort")
POLICIES = (QoSPolicyKind.RELIABILITY, QoSPolicyKind.DEPTH)


def check_overrides(given: Mapping[str, Any], topics: Iterable[str]) -> None:
    """Raise ConfigError for an override that is wrong or that no subscription takes.

    rclpy ignores the latter. ``topics`` are the full names of the topics whose subscriptions take
    overrides.
    """
    known = [
        f"{OVERRIDES}{topic}.subscription.{policy.name.lower()}"
        for topic in topics
        for policy in POLICIES
    ]
    for name, value in given.items():
        if name not in known:
            hint = (
                nearest(name, known) if known else "this node has no quality of service to override"
            )
            raise ConfigError(f"unknown parameter {name}: {hint}")
        if name.endswith(".depth") and not (type(value) is int and 1 <= value <= MAX_DEPTH):
            raise ConfigError(
                f"parameter {name}: expected a whole number from 1 to {MAX_DEPTH}, got {value!r}"
            )
        if name.endswith(".reliability") and value not in RELIABILITY:
            raise ConfigError(
                f"parameter {name}: expected {' or '.join(RELIABILITY)}, got {value!r}"
            )


def subscribe(
    node: Node,
    type_name: str,
    topic: str,
    callback: Callable[..., None],
    qos: QoSProfile,
    **options: Any,
) -> Subscription:
    """Subscribe with ``qos`` and the user's overrides of it; ``options`` are rclpy's."""
    return node.create_subscription(
        message_class(type_name),
        topic,
        callback,
        copy.copy(qos),
        qos_overriding_options=QoSOverridingOptions(POLICIES),
        **options,
    )


def qos_in_force(node: Node, topic: str, default: QoSProfile) -> QoSProfile:
    """Return the quality of service of the node's subscription to ``topic``, else ``default``.

    ``topic`` is the name with which the subscription was made.
    """
    return next((each.qos_profile for each in node.subscriptions if each.topic == topic), default)
