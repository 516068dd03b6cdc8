# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A rover from its URDF, as yourdfpy reads it.

Wheels are the continuous joints whose child has a cylinder and whose axis lies across the body. A
passive joint is one about an axis across the body that carries the wheels of two neighbouring axles
of more, a steering joint one about a vertical axis that carries one wheel. A joint across the body
that carries a wheel of every axle is that of a rocker. Places are those at joint angles of zero.
"""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from rover_parameters.records import ConfigError
from rover_parameters.regular_file import read_regular
from terrain_estimator.observation import Floats

if TYPE_CHECKING:
    from yourdfpy import URDF, Joint, Link

ALIKE = 1e-3
"""[m] By how much places and sizes of wheels may differ that are taken as one."""
UPRIGHT = 0.99
"""[1] Least component of a joint's axis along the body's, which it is then taken for."""
_TURNS = ("continuous", "revolute")
_LARGEST = 1 << 24  # bytes


@dataclass(frozen=True, slots=True)
class Given:
    """What a URDF leaves open, or what replaces it; NaN takes the URDF's."""

    body_frame: str
    gravity: float  # [m/s^2]
    cruise_speed: tuple[float, float]  # [m/s]
    mass: float = math.nan  # [kg]
    centre_of_mass: tuple[float, float] = (math.nan, math.nan)  # [m] along the body, above ground
    wheel_inertia: float = math.nan  # [kg m^2]


@dataclass(frozen=True, slots=True)
class FoundRover:
    """Content of a rover file, and what a model by wheel needs beside it."""

    content: dict[str, Any]
    track_width: float  # [m]
    steered: tuple[str, ...]  # names of the wheels that a joint steers


@dataclass(frozen=True, slots=True)
class _Wheel:
    name: str
    link: str
    place: Floats  # [3] [m] of the axle in the body's frame
    radius: float  # [m]
    width: float  # [m]
    steered: bool


def read_urdf(path: Path) -> "URDF":
    """Return a file as yourdfpy reads it, without its meshes. Raises ConfigError."""
    try:
        import yourdfpy  # noqa: PLC0415 - for this command alone
    except ImportError as error:
        raise ConfigError(
            f"{path}: reading a URDF needs yourdfpy ({error}): pip install yourdfpy"
        ) from error
    try:
        content = read_regular(path, _LARGEST)
        return yourdfpy.URDF.load(io.BytesIO(content), load_meshes=False, build_scene_graph=True)
    except Exception as error:
        raise ConfigError(
            f"{path}: no URDF that can be read: {error}: expand xacro first"
        ) from error


def rover_of_urdf(robot: "URDF", given: Given) -> FoundRover:
    """Return the rover of a URDF. Raises ConfigError where it is of no kind that is supported."""
    if given.body_frame not in robot.link_map:
        raise ConfigError(
            f"link {given.body_frame} is not in the URDF: it has {', '.join(robot.link_map)}; give"
            " --body-frame"
        )
    wheels = _wheels(robot, given.body_frame)
    radius, width = (_one(name, wheels) for name in ("radius", "width"))
    heights = [float(wheel.place[2]) for wheel in wheels]
    if max(heights) - min(heights) > ALIKE:
        raise ConfigError(
            f"the axles are {min(heights):g} to {max(heights):g} m above {given.body_frame}: all"
            " wheels have to stand on one level at joint angles of zero"
        )
    ground = sum(heights) / len(heights) - radius
    axle_x, axles = _axles(wheels)
    mass, centre = _mass(robot, given, ground)
    content: dict[str, Any] = {
        "name": robot.robot.name,
        "mass": mass,
        "gravity": given.gravity,
        "wheel_radius": radius,
        "wheel_width": width,
        "wheel_inertia": _wheel_inertia(robot, wheels, given),
        "axle_x": axle_x,
        "centre_of_mass_x": centre[0],
        "centre_of_mass_height": centre[1],
    }
    joints, rockers = _passive_joints(robot, given.body_frame, wheels, axles, ground)
    if joints:
        content["joints"] = joints
        # rockers that turn against the body need a differential
        content |= {} if rockers else {"differential": False}
    content |= {
        "cruise_speed": list(given.cruise_speed),
        "sinkage_noise_floor": 0.0003,
        "wheels": [
            {"name": wheel.name, "axle": axle, "side": "left" if wheel.place[1] > 0.0 else "right"}
            for wheel, axle in zip(wheels, axles, strict=True)
        ],
    }
    across = [abs(float(wheel.place[1])) for wheel in wheels]
    steered = tuple(wheel.name for wheel in wheels if wheel.steered)
    return FoundRover(content, _rounded(2.0 * max(across)), steered)


def _wheels(robot: "URDF", body: str) -> list[_Wheel]:
    """Return the wheels, front to rear and left before right."""
    found = []
    for name, joint in robot.joint_map.items():
        cylinder = _cylinder(robot.link_map[joint.child])
        if joint.type != "continuous" or cylinder is None or _axis(robot, joint, body) != "y":
            continue
        place = robot.get_transform(joint.child, body)[:3, 3]
        if abs(place[1]) < ALIKE:
            raise ConfigError(f"wheel {name} is in the middle of {body}: give each side its own")
        above = [each for each in robot.joint_map.values() if each.child == joint.parent]
        steered = any(each.type in _TURNS and _axis(robot, each, body) == "z" for each in above)
        found.append(_Wheel(name, joint.child, place, *cylinder, steered))
    if not found:
        raise ConfigError(
            "no wheel: a wheel is the child of a continuous joint about an axis across the body,"
            " and has a cylinder as collision or visual"
        )
    return sorted(found, key=lambda wheel: (-round(wheel.place[0] / ALIKE), wheel.place[1] < 0.0))


def _cylinder(link: "Link") -> tuple[float, float] | None:
    """Return radius and length [m] of the first cylinder of a link, collisions before visuals."""
    for each in (*link.collisions, *link.visuals):
        cylinder = each.geometry.cylinder
        if cylinder is not None:
            return float(cylinder.radius), float(cylinder.length)
    return None


def _axis(robot: "URDF", joint: "Joint", body: str) -> str:
    """Return the axis of the body along which that of a joint lies, empty where none is."""
    along = robot.get_transform(joint.child, body)[:3, :3] @ np.asarray(joint.axis, dtype=float)
    place = int(np.argmax(np.abs(along)))
    return "xyz"[place] if abs(along[place]) > UPRIGHT * np.linalg.norm(along) else ""


def _one(name: str, wheels: Sequence[_Wheel]) -> float:
    values = [getattr(wheel, name) for wheel in wheels]
    if max(values) - min(values) > ALIKE:
        said = ", ".join(f"{wheel.name} {getattr(wheel, name):g}" for wheel in wheels)
        raise ConfigError(f"the wheels differ in their {name} [m]: {said}; one size is supported")
    return _rounded(values[0])


def _axles(wheels: Sequence[_Wheel]) -> tuple[list[float], list[int]]:
    """Return the places of the axles along the body, front to rear, and the axle of each wheel."""
    places: list[float] = []
    axles = []
    for wheel in wheels:
        x = float(wheel.place[0])
        if not places or places[-1] - x > ALIKE:
            places.append(_rounded(x))
        axles.append(len(places) - 1)
    return places, axles


def _passive_joints(
    robot: "URDF", body: str, wheels: Sequence[_Wheel], axles: Sequence[int], ground: float
) -> tuple[list[dict[str, Any]], bool]:
    """Return the joints that carry two neighbouring axles of more, left and right as one.

    Also whether rockers turn against the body.
    """
    found: dict[tuple[int, ...], Floats] = {}
    every, rockers = len(set(axles)), False
    for joint in robot.joint_map.values():
        if joint.type not in _TURNS or _axis(robot, joint, body) != "y":
            continue
        below = _links_below(robot, joint.child)
        carried = tuple(
            sorted({axle for wheel, axle in zip(wheels, axles, strict=True) if wheel.link in below})
        )
        rockers = rockers or len(carried) == every
        if not 1 < len(carried) < every:
            continue  # a wheel, or a rocker
        pivot = robot.get_transform(joint.child, body)[[0, 2], 3]
        if carried in found and np.abs(found[carried] - pivot).max() > ALIKE:
            raise ConfigError(f"the joints of axles {list(carried)} have two places left and right")
        found[carried] = pivot
    joints = [
        {"axles": list(carried), "x": _rounded(pivot[0]), "height": _rounded(pivot[1] - ground)}
        for carried, pivot in found.items()
    ]
    return joints, rockers


def _links_below(robot: "URDF", link: str) -> set[str]:
    below, left = set(), [link]
    while left:
        here = left.pop()
        below.add(here)
        left += [each.child for each in robot.joint_map.values() if each.parent == here]
    return below


def _mass(robot: "URDF", given: Given, ground: float) -> tuple[float, tuple[float, float]]:
    """Return mass [kg] and centre of mass [m], along the body and above the ground."""
    parts = [
        (link.inertial.mass, robot.get_transform(link.name, given.body_frame), link.inertial.origin)
        for link in robot.link_map.values()
        if link.inertial is not None and link.inertial.mass
    ]
    whole = sum(mass for mass, _, _ in parts)
    mass = whole if math.isnan(given.mass) else given.mass
    if not mass > 0.0:
        raise ConfigError(
            "the URDF has no masses: give --mass, --centre-of-mass and --wheel-inertia"
        )
    x, height = given.centre_of_mass
    if math.isnan(x) or math.isnan(height):
        if not whole > 0.0:
            raise ConfigError("the URDF has no masses: give --centre-of-mass X HEIGHT [m]")
        centre = sum(
            part * (place @ (np.eye(4) if origin is None else origin))[:3, 3]
            for part, place, origin in parts
        )
        x, height = float(centre[0] / whole), float(centre[2] / whole) - ground
    return _rounded(mass), (_rounded(x), _rounded(height))


def _wheel_inertia(robot: "URDF", wheels: Sequence[_Wheel], given: Given) -> float:
    """Return the largest moment of a wheel's tensor, which is that about its axle [kg m^2]."""
    if not math.isnan(given.wheel_inertia):
        return given.wheel_inertia
    found = []
    for wheel in wheels:
        inertial = robot.link_map[wheel.link].inertial
        if inertial is None or inertial.inertia is None:
            raise ConfigError(f"wheel {wheel.name} has no inertia: give --wheel-inertia [kg m^2]")
        found.append(float(np.linalg.eigvalsh(np.asarray(inertial.inertia, dtype=float)).max()))
    return _rounded(max(found))


def _rounded(value: float) -> float:
    """Return a value to a nanometre, or a nanogram: what a transform adds is rounding."""
    return round(float(value), 9) + 0.0


def rover_yaml(found: FoundRover, source: str) -> str:
    """Return the text of the rover file."""
    head = (
        f"# From {source}. cruise_speed and sinkage_noise_floor are not in a URDF, and a wheel's\n"
        "# inertia there is without its drive: check them.\n"
    )
    return head + yaml.safe_dump(found.content, sort_keys=False)
