# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The URDF of a rover, from its rover file alone: for robot_state_publisher and RViz.

Its joints have the names and signs of joint_states. It has shapes and no inertia: the rover file
does not say how the mass is distributed, so that it is for viewers, not for a physics engine.
"""

import math
from collections.abc import Collection
from xml.etree import ElementTree as ET

from rover_parameters.records import ConfigError
from terramechanics.description.layout import (
    BOGIE,
    ROCKER,
    STEERING_SUFFIX,
    Point,
    suspension_joints,
    track_width_of,
    wheel_sides,
)
from terramechanics.vehicle.rover import Rover

BODY_FRAME = "base_link"
"""Link of the body by REP 105."""
FORWARD = "0 1 0"
"""Axis of a wheel, whose rate is positive where it rolls forward."""
TO_THE_LEFT = "0 0 1"
"""Axis of a joint that steers a wheel, whose angle is positive to the left."""
NOSE_UP = "0 -1 0"
"""Axis of a joint of the suspension, whose angle is positive nose up."""
_COLOURS = {"body": "0.75 0.75 0.78 1", "arm": "0.45 0.47 0.5 1", "tyre": "0.2 0.2 0.22 1"}


def to_urdf(
    rover: Rover,
    *,
    track_width: float = 0.0,
    body_frame: str = BODY_FRAME,
    steered: Collection[str] = (),
) -> str:
    """Return the URDF as text.

    ``track_width`` [m] is the distance of left and right wheels; 0: a usual one. Each wheel
    that ``steered`` names has a joint for that.

    Raises:
        ConfigError: the wheels do not fit beside each other, two parts would have one name, or a
            name is not printable.
    """
    track_width = track_width_of(rover, track_width)
    sides = wheel_sides(rover, track_width)
    is_left = [wheel.side == "left" for wheel in rover.wheels]
    if [y > 0.0 for y in sides] != is_left:
        raise ConfigError(
            f"a track width of {track_width:g} m has no room for the wheels of {rover.name}"
        )
    _check_names(rover, body_frame, steered)
    robot = ET.Element("robot", name=rover.name)
    for name, colour in _COLOURS.items():
        ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=colour)
    body = _link(robot, body_frame)
    centre = (rover.centre_of_mass_x, 0.0, rover.centre_of_mass_height)
    size = (
        rover.axle_x[0] - rover.axle_x[-1],
        max(track_width - 3.0 * rover.wheel_width, 0.5 * track_width),
        0.5 * rover.wheel_radius,
    )
    _shape(body, "box", "body", centre, size=_words(size))
    parents = _suspension(robot, rover, body, centre, track_width)
    for wheel, y in zip(rover.wheels, sides, strict=True):
        link = _link(robot, f"{wheel.name}_wheel")
        parent, origin = parents[wheel.axle]
        x, z = rover.axle_x[wheel.axle] - origin[0], rover.wheel_radius - origin[2]
        place = (x, y, z)
        if wheel.name in steered:
            name = f"{wheel.name}{STEERING_SUFFIX}"
            fork = _link(robot, f"{name}_link")
            _joint(robot, name, (parent, fork), place, TO_THE_LEFT)
            parent, place = fork, (0.0, 0.0, 0.0)
        _joint(robot, wheel.name, (parent, link), place, FORWARD)
        # the axis of a cylinder is z
        _shape(
            link,
            "cylinder",
            "tyre",
            (0.0, 0.0, 0.0),
            (0.5 * math.pi, 0.0, 0.0),
            radius=f"{rover.wheel_radius:g}",
            length=f"{rover.wheel_width:g}",
        )
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _check_names(rover: Rover, body_frame: str, steered: Collection[str]) -> None:
    joints = list(suspension_joints(rover))
    joints += [f"{name}{STEERING_SUFFIX}" for name in rover.wheel_names if name in steered]
    links = [body_frame, *(f"{name}_link" for name in joints)]
    links += [f"{name}_wheel" for name in rover.wheel_names]
    for names in ([*joints, *rover.wheel_names], links):
        twice = [name for index, name in enumerate(names) if name in names[:index]]
        if twice:
            raise ConfigError(f"{twice[0]} would be the name of two parts: rename wheel or frame")
        unfit = [name for name in names if not name.isprintable()]
        if unfit:
            raise ConfigError(f"the name {unfit[0]!r} has characters that XML does not take")


def _suspension(
    robot: ET.Element, rover: Rover, body: ET.Element, centre: Point, track_width: float
) -> dict[int, tuple[ET.Element, Point]]:
    """Add rocker and bogie; return the link that carries each axle, with its origin.

    The rover file has no place of the rocker's pivot, as its rocker does not turn against the body:
    it is drawn in the centre of mass. Without a differential the body is the rocker.
    """
    aside = max(0.5 * track_width - rover.wheel_width, 0.0)
    on_body = [axle for axle in range(rover.axles) if not rover.is_on_joint(axle)]
    rocker, origin = body, (0.0, 0.0, 0.0)
    if ROCKER in suspension_joints(rover):
        rocker, origin = _link(robot, f"{ROCKER}_link"), centre
        _joint(robot, ROCKER, (body, rocker), centre, NOSE_UP)
    _arms(rocker, rover, on_body, centre, origin, aside)
    carriers = dict.fromkeys(on_body, (rocker, origin))
    for joint in rover.suspension:
        bogie, pivot = _link(robot, f"{BOGIE}_link"), (joint.x, 0.0, joint.height)
        offset = (pivot[0] - origin[0], 0.0, pivot[2] - origin[2])
        _joint(robot, BOGIE, (rocker, bogie), offset, NOSE_UP)
        _arms(bogie, rover, list(joint.axles), pivot, pivot, aside)
        carriers |= dict.fromkeys(joint.axles, (bogie, pivot))
    return carriers


def _arms(
    link: ET.Element, rover: Rover, axles: list[int], start: Point, origin: Point, aside: float
) -> None:
    """Draw a bar on both sides from ``start`` to each axle, in a link with this ``origin``."""
    thick = 0.4 * rover.wheel_width
    for axle in axles:
        along, up = rover.axle_x[axle] - start[0], rover.wheel_radius - start[2]
        x, z = start[0] + 0.5 * along - origin[0], start[2] + 0.5 * up - origin[2]
        size = _words((math.hypot(along, up), thick, thick))
        for y in (aside, -aside):
            # a positive rotation about y is nose down
            _shape(link, "box", "arm", (x, y, z), (0.0, math.atan2(-up, along), 0.0), size=size)


def _link(robot: ET.Element, name: str) -> ET.Element:
    return ET.SubElement(robot, "link", name=name)


def _joint(
    robot: ET.Element, name: str, links: tuple[ET.Element, ET.Element], origin: Point, axis: str
) -> None:
    joint = ET.SubElement(robot, "joint", name=name, type="continuous")
    for role, link in zip(("parent", "child"), links, strict=True):
        ET.SubElement(joint, role, link=link.attrib["name"])
    ET.SubElement(joint, "origin", xyz=_words(origin))
    ET.SubElement(joint, "axis", xyz=axis)


def _shape(
    link: ET.Element,
    kind: str,
    material: str,
    origin: Point,
    turned: Point = (0.0, 0.0, 0.0),
    **sizes: str,
) -> None:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=_words(origin), rpy=_words(turned))
    ET.SubElement(ET.SubElement(visual, "geometry"), kind, sizes)
    ET.SubElement(visual, "material", name=material)


def _words(values: tuple[float, ...]) -> str:
    """Return values as URDF writes them, to a nanometre; adding 0 makes -0 plain."""
    return " ".join(f"{round(value, 9) + 0.0:.10g}" for value in values)
