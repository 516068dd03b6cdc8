# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What viewers draw beside the measurements: the rover's tf, its wheels, the forces on them."""

import math

from geometry_msgs.msg import Point, Pose, Quaternion, TransformStamped, Vector3
from nav_msgs.msg import Odometry
from std_msgs.msg import ColorRGBA, Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from rover_sim_node.reading import SimulatedReading
from terramechanics.description.layout import track_width_of, wheel_centres

ARROW_RADII = 2.0
"""[wheel radii] Length of the arrow of a wheel's share of the weight."""
SLIPPING = 0.6
"""[1] Slip from which a wheel is drawn red."""
ARROW = ColorRGBA(r=1.0, g=0.75, b=0.1, a=1.0)
UNKNOWN = ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.8)


def transform_message(odometry: Odometry) -> TFMessage:
    """Return the pose of the odometry as the transform from its frame to the body's."""
    place, turned = odometry.pose.pose.position, odometry.pose.pose.orientation
    transform = TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
    transform.transform.translation = Vector3(x=place.x, y=place.y, z=place.z)
    transform.transform.rotation = turned
    return TFMessage(transforms=[transform])


def marker_message(reading: SimulatedReading, header: Header, track_width: float) -> MarkerArray:
    """Return the wheels, coloured by measured slip, and the true forces of the ground on them.

    ``header`` has the frame of the body. A force that is not known has no arrow.
    """
    centres = wheel_centres(
        reading.rover, track_width_of(reading.rover, track_width), reading.bogie_angle
    )
    markers = []
    for index, centre in enumerate(centres):
        slip, force = float(reading.measured.slip[index]), reading.ground_force[index].tolist()
        markers += [
            _wheel(reading, header, index, centre, slip),
            _force(reading, header, index, centre, force),
        ]
    return MarkerArray(markers=markers)


def _wheel(
    reading: SimulatedReading,
    header: Header,
    index: int,
    centre: tuple[float, float, float],
    slip: float,
) -> Marker:
    x, y, z = centre
    diameter = 2.0 * reading.rover.wheel_radius
    return Marker(
        header=header,
        ns="wheels",
        id=index,
        type=Marker.CYLINDER,
        action=Marker.ADD,
        pose=Pose(position=Point(x=x, y=y, z=z), orientation=_turned(_steered(reading, index))),
        scale=Vector3(x=diameter, y=diameter, z=reading.rover.wheel_width),
        color=_colour(slip),
    )


def _force(
    reading: SimulatedReading,
    header: Header,
    index: int,
    centre: tuple[float, float, float],
    force: list[float],
) -> Marker:
    """Return the arrow of a force: normal and traction [N], at a contact angle [rad], and aside."""
    rover = reading.rover
    normal, traction, tilt, aside = force
    ahead, above = -math.sin(tilt), math.cos(tilt)  # of the normal, away from the ground
    along = normal * ahead + traction * above
    upward = normal * above - traction * ahead
    scale = ARROW_RADII * rover.wheel_radius * len(rover.wheels) / rover.weight
    length = scale * math.hypot(along, upward, aside)
    marker = Marker(header=header, ns="forces", id=index, type=Marker.ARROW, color=ARROW)
    if not 0.0 < length < math.inf:
        marker.action = Marker.DELETE
        return marker
    (x, y, z), angle = centre, _steered(reading, index)
    cosine, sine = math.cos(angle), math.sin(angle)
    back, below = rover.wheel_radius * ahead, z - rover.wheel_radius * above
    foot = Point(x=x - back * cosine, y=y - back * sine, z=below)
    reach, left = scale * along, scale * aside
    tip = Point(
        x=foot.x + reach * cosine - left * sine,
        y=foot.y + reach * sine + left * cosine,
        z=below + scale * upward,
    )
    thick = 0.1 * rover.wheel_radius
    marker.points, marker.scale = [foot, tip], Vector3(x=thick, y=2.5 * thick, z=2.5 * thick)
    return marker


def _steered(reading: SimulatedReading, index: int) -> float:
    """Return the steering angle [rad] of a wheel, to the left."""
    return 0.0 if reading.steering is None else float(reading.steering[index])


def _turned(angle: float) -> Quaternion:
    """Return what turns the z axis of a cylinder to that of a wheel steered by ``angle``."""
    cosine, sine = math.sqrt(0.5) * math.cos(0.5 * angle), math.sqrt(0.5) * math.sin(0.5 * angle)
    return Quaternion(x=cosine, y=sine, z=sine, w=cosine)


def _colour(slip: float) -> ColorRGBA:
    """Return green where a wheel rolls, red where it slips, grey where it stands."""
    if math.isnan(slip):
        return UNKNOWN
    share = min(abs(slip) / SLIPPING, 1.0)
    return ColorRGBA(r=share, g=1.0 - share, b=0.1, a=0.8)
