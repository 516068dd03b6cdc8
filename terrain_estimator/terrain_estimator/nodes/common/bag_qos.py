# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The quality of service of a publisher as a bag stores it."""

from rclpy.topic_endpoint_info import TopicEndpointInfo

from terrain_estimator.bags import Qos
from terrain_estimator.bags.format.qos import INFINITE_NS


def bag_qos(publisher: TopicEndpointInfo) -> Qos:
    """Return the quality of service that a publisher offers, as a bag stores it."""
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


def _duration_ns(nanoseconds: int) -> int:
    """Return a duration, and infinity for one that is not set, as DDS understands it."""
    return nanoseconds or INFINITE_NS
