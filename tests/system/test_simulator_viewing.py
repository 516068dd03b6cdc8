# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator's tf and markers, on real DDS, and without them where they are not wanted."""

from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from tests.system.listening import Listener
from tests.system.processes import Starter

VIEWED = ("/tf", "wheel_markers")


def test_every_step_has_the_transform_of_its_odometry_and_the_wheels_in_the_body_frame(
    start: Starter, listener: Listener
) -> None:
    given = (
        "odom_frame:=track",
        "body_frame:=chassis",
        "track_width:=1.0",
        "publish_markers:=true",
    )
    parameters = [word for each in given for word in ("-p", each)]
    process = start("rover_sim_node", "simulator", "--ros-args", *parameters)
    odometry = listener.collect(Odometry, "odom")
    listener.wait_for_messages(odometry, 1)  # so that no transform is older
    transforms = listener.collect(TFMessage, "/tf")
    drawn = listener.collect(MarkerArray, "wheel_markers")
    for messages in (odometry, transforms, drawn):
        listener.wait_for_messages(messages, 6)
    poses = {
        (each.header.stamp.sec, each.header.stamp.nanosec): each.pose.pose for each in odometry
    }
    for message in transforms[1:5]:
        (transform,) = message.transforms
        assert (transform.header.frame_id, transform.child_frame_id) == ("track", "chassis")
        pose = poses[transform.header.stamp.sec, transform.header.stamp.nanosec]
        assert transform.transform.rotation == pose.orientation
        assert transform.transform.translation.x == pose.position.x
    assert [(marker.ns, marker.id) for marker in drawn[0].markers[:2]] == [
        ("wheels", 0),
        ("forces", 0),
    ]
    assert {marker.header.frame_id for marker in drawn[0].markers} == {"chassis"}
    assert drawn[0].markers[0].pose.position.y == 0.5
    assert process.interrupt() == 0


def test_where_they_are_not_wanted_nobody_publishes_them(
    start: Starter, listener: Listener
) -> None:
    off = ("-p", "publish_tf:=false", "-p", "publish_markers:=false")
    process = start("rover_sim_node", "simulator", "--ros-args", *off)
    listener.wait_for_messages(listener.collect(Odometry, "odom"), 2)
    assert [listener.node.count_publishers(topic) for topic in VIEWED] == [0, 0]
    assert process.interrupt() == 0
