# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Compare the publishers of a topic with a subscription or a recording of it."""

from collections.abc import Iterable, Iterator

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from terrain_estimator.messaging.diagnostics import PUBLISHERS, CheckResult
from terrain_estimator.nodes.common.qos import qos_in_force


def incompatible_publishers(node: Node, topic: str, type_name: str, qos: QoSProfile) -> CheckResult:
    """Count the publishers of ``topic`` that the node cannot receive, and name their nodes.

    These have another type, or a quality of service that does not match that of the node's
    subscription; ``qos`` stands in where there is no subscription.
    """
    taken = qos_in_force(node, topic, qos)
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


def type_conflicts(
    publishers: Iterable[TopicEndpointInfo], type_name: str, type_hash: str
) -> Iterator[str]:
    """Yield a sentence for each publisher of another type, or of another definition of the type.

    DDS matches a publisher of another definition, whose bytes the installed definition would
    decode wrongly. The sentence names no node: DDS discovers a publisher before the name of its
    node.
    """
    for publisher in publishers:
        theirs = str(publisher.topic_type_hash)
        if publisher.topic_type != type_name:
            yield f"a publisher of {publisher.topic_type} is left out, only {type_name} is recorded"
        elif theirs.startswith("RIHS") and theirs != type_hash:
            yield (
                f"a publisher has another definition of {type_name} than the installed one: its"
                " messages may not be readable"
            )
