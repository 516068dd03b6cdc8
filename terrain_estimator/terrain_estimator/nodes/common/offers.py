# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the publishers of a topic offer, and which of them a recording has to leave out."""

from collections.abc import Iterable, Iterator

from rclpy.topic_endpoint_info import TopicEndpointInfo

from terrain_estimator.bags import Qos
from terrain_estimator.bags.format.qos import INFINITE_NS


def offered(publisher: TopicEndpointInfo) -> Qos:
    """Quality of service of a publisher, as a bag stores it."""
    profile = publisher.qos_profile
    return Qos(
        history=profile.history.short_key,
        depth=profile.depth,
        reliability=profile.reliability.short_key,
        durability=profile.durability.short_key,
        deadline_ns=_duration_ns(profile.deadline.nanoseconds),
        lifespan_ns=_duration_ns(profile.lifespan.nanoseconds),
        liveliness=profile.liveliness.short_key,
        liveliness_lease_ns=_duration_ns(profile.liveliness_lease_duration.nanoseconds),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def of_other_types(
    publishers: Iterable[TopicEndpointInfo], type_name: str, type_hash: str
) -> Iterator[str]:
    """A sentence for each publisher whose messages are not of the recorded type, or of another definition of it.

    DDS lets a publisher of another definition through, and its bytes would be read by the wrong
    one. Nodes are not named: DDS finds a publisher before the name of its node.
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


def _duration_ns(nanoseconds: int) -> int:
    """Give "not set" as infinite, which is what DDS does with it."""
    return nanoseconds or INFINITE_NS
