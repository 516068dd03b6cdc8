# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The map as a process of its own."""

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_defs.msg import TerrainEstimate
from terrain_estimator.messaging.map_track import POINT
from terrain_estimator.nodes.common import message_types
from tests.drives import drive_messages
from tests.system.listening import LATCHED, Listener
from tests.system.processes import Starter


def test_the_track_is_a_cloud_that_a_late_reader_gets(start: Starter, listener: Listener) -> None:
    parameters = ("period:=0.5", "spacing:=0.05", "points:=12", "pairing_tolerance:=0.01")
    process = start(
        "terrain_estimator",
        "terrain_map",
        "--ros-args",
        *(word for each in parameters for word in ("-p", each)),
    )
    process.wait_for_output("ready", timeout=60.0)
    early = listener.collect(PointCloud2, "terrain_map", LATCHED)
    odometry = listener.publisher(message_types.message_class("nav_msgs/msg/Odometry"), "odom")
    estimates = listener.publisher(TerrainEstimate, "terrain_estimate")

    def drive() -> None:
        for step, message in enumerate(
            message
            for topic, _, message in drive_messages(message_types.make, 3.0)
            if topic == "odom"
        ):
            message.pose.pose.position.x = 0.03 * step
            header = message.header
            estimates.publish(
                TerrainEstimate(header=header, cohesion=1500.0, tan_phi=0.6, observations_used=1)
            )
            message.header.stamp.nanosec += 5_000_000
            odometry.publish(message)
            listener.spin_until(lambda: True, "what came is taken")

    drive()
    listener.wait_for_messages(early, 6)  # all of 3 s: the cloud before has too few points
    late = listener.collect(PointCloud2, "terrain_map", LATCHED)
    listener.wait_for_messages(late, 1)
    cloud = late[0]
    points = np.frombuffer(bytes(cloud.data), dtype=POINT)
    assert cloud.header.frame_id == "odom"
    assert 6 <= cloud.width == len(points) <= 12
    np.testing.assert_allclose(
        np.diff(points["x"]), 0.12, atol=1e-5
    )  # 15 points of 0.06 m are too many
    assert points["cohesion"].tolist() == [1500.0] * len(points)
    drive()  # the same stamps once more: another run
    listener.spin_until(lambda: 1 in [each.width for each in late], "the map begins anew")
    assert process.interrupt(60.0) == 0
