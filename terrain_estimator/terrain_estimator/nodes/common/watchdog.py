# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Finds publishers that a subscription will never hear, and names their nodes."""

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from terrain_estimator.messaging.diagnostics import PUBLISHERS, CheckResult
from terrain_estimator.nodes.common.quality import in_force


def unheard_publishers(node: Node, topic: str, type_name: str, qos: QoSProfile) -> CheckResult:
    """Publishers of ``topic`` with another type, or with a quality of service that the node's subscription, or ``qos``, does not match."""
    taken = in_force(node, topic, qos)
    problems = []
    for publisher in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
        name = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
        compatibility, reason = qos_check_compatible(publisher.qos_profile, taken)
        if publisher.topic_type != type_name:
            problems.append(f"{name} publishes {publisher.topic_type}, not {type_name}")
        elif compatibility == QoSCompatibility.ERROR:
            problems.append(
                f"incompatible quality of service with {name}:"
                f" {' '.join(reason.removeprefix('ERROR: ').split()).rstrip(';').lower()}"
            )
    return PUBLISHERS.judge(len(problems), topic, f"{topic}: {'; '.join(problems) or 'none'}")
