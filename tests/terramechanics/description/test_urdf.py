# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The URDF as a library of others reads it: joints, places and signs are the rover file's."""

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
import yourdfpy

from rover_parameters.records import ConfigError
from rover_sim_node.config import SimulatorConfig
from rover_sim_node.messages import step_messages
from rover_sim_node.run import SimulatedRun
from rover_sim_node.turning_run import TurningRun
from terramechanics.description.layout import track_width_of, wheel_centres
from terramechanics.description.urdf import to_urdf
from terramechanics.presets import load_rover, rover_names
from terramechanics.vehicle.rover import Rover, Wheel
from tests.rovers import BOGIE_IN_FRONT, EIGHT_WHEELS, FIXED_ROCKERS, rover_file

ROVERS = (
    *(load_rover(name) for name in rover_names()),
    BOGIE_IN_FRONT,
    EIGHT_WHEELS,
    FIXED_ROCKERS,
)
every_rover = pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)


def read(rover: Rover, track_width: float = 0.0, *, steered: bool = False) -> yourdfpy.URDF:
    names = rover.wheel_names if steered else ()
    text = to_urdf(rover, track_width=track_width, steered=names).encode()
    return yourdfpy.URDF.load(io.BytesIO(text), load_meshes=False)


def centre(robot: yourdfpy.URDF, wheel: str) -> np.ndarray:
    return robot.get_transform(f"{wheel}_wheel", "base_link")[:3, 3]


def test_every_preset_is_among_the_rovers() -> None:
    assert {"mars_rover", "paper_rover", "four_wheel_rover"} <= {rover.name for rover in ROVERS}


@every_rover
def test_a_reader_of_others_takes_it_and_finds_nothing_wrong(rover: Rover) -> None:
    robot = read(rover)
    assert robot.validate()
    assert robot.base_link == "base_link"
    assert robot.robot.name == rover.name
    assert set(robot.scene.graph.nodes) >= {f"{name}_wheel" for name in rover.wheel_names}


@pytest.mark.parametrize("name", rover_names())
def test_its_joints_are_those_of_the_joint_states(name: str) -> None:
    config = SimulatorConfig(rover=name)
    states = step_messages(SimulatedRun(config).step(), config, 0, 0)["joint_states"]
    assert sorted(read(load_rover(name)).actuated_joint_names) == sorted(states.name)


@pytest.mark.parametrize("name", rover_names())
@pytest.mark.parametrize("steering", ["all_wheels", "ackermann"])
def test_a_steered_rover_has_the_joints_of_its_joint_states(name: str, steering: str) -> None:
    config = SimulatorConfig(rover=name, steering=steering, schedule="cmd_vel")
    states = step_messages(TurningRun(config).step(), config, 0, 0)["joint_states"]
    robot = read(load_rover(name), steered=True)
    assert sorted(robot.actuated_joint_names) == sorted(states.name)


@pytest.mark.parametrize("rover", [EIGHT_WHEELS, FIXED_ROCKERS], ids=lambda rover: rover.name)
def test_rovers_of_models_by_wheel_have_the_joints_of_their_joint_states(
    rover: Rover, tmp_path: Path
) -> None:
    """Fixed rockers are the body, so that there is no joint of them."""
    name = rover_file(rover, tmp_path / "rover.yaml")
    config = SimulatorConfig(rover=name, steering="skid", schedule="cmd_vel")
    states = step_messages(TurningRun(config).step(), config, 0, 0)["joint_states"]
    assert sorted(read(rover).actuated_joint_names) == sorted(states.name)
    assert "rocker" not in states.name


@every_rover
def test_a_positive_steering_angle_is_to_the_left_and_keeps_the_wheels_place(rover: Rover) -> None:
    robot, first = read(rover, steered=True), rover.wheel_names[0]
    place = centre(robot, first)
    np.testing.assert_allclose(place, centre(read(rover), first), atol=1e-9)
    ahead = np.array([rover.wheel_radius, 0.0, 0.0, 1.0])
    robot.update_cfg({f"{first}_steering": 0.3})
    moved = robot.get_transform(f"{first}_wheel", "base_link") @ ahead
    np.testing.assert_allclose(centre(robot, first), place, atol=1e-9)
    assert moved[1] - place[1] == pytest.approx(rover.wheel_radius * np.sin(0.3))


@every_rover
@pytest.mark.parametrize("angle", [0.0, 0.2, -0.1])
def test_wheels_are_where_the_rover_file_has_them_also_when_the_bogie_turns(
    rover: Rover, angle: float
) -> None:
    robot = read(rover)
    if rover.suspension:
        robot.update_cfg({"bogie": angle} | ({"rocker": 0.0} if rover.differential else {}))
    expected = wheel_centres(rover, track_width_of(rover), angle)
    for wheel, place in zip(rover.wheels, expected, strict=True):
        np.testing.assert_allclose(centre(robot, wheel.name), place, atol=1e-8)
        assert (place[1] > 0.0) == (wheel.side == "left")


def test_a_positive_angle_of_the_bogie_is_nose_up_and_a_positive_rate_rolls_forward() -> None:
    robot = read(load_rover("mars_rover"))
    level = centre(robot, "middle_left")[2]
    robot.update_cfg({"bogie": 0.1})
    assert centre(robot, "middle_left")[2] > level > centre(robot, "rear_left")[2]
    top = np.array([0.0, 0.0, 0.13, 1.0])
    robot.update_cfg({"front_left": 0.1})
    moved = robot.get_transform("front_left_wheel", "base_link") @ top
    assert moved[0] > centre(robot, "front_left")[0]


def test_the_shape_of_a_wheel_is_that_of_the_rover_file() -> None:
    rover = load_rover("four_wheel_rover")
    (visual,) = read(rover).link_map["rear_right_wheel"].visuals
    cylinder = visual.geometry.cylinder
    assert (cylinder.radius, cylinder.length) == (rover.wheel_radius, rover.wheel_width)
    assert visual.origin @ [0.0, 0.0, 1.0, 1.0] == pytest.approx([0.0, -1.0, 0.0, 1.0], abs=1e-8)


def test_the_track_is_what_one_says_else_three_quarters_of_the_wheelbase() -> None:
    rover = load_rover("mars_rover")
    assert centre(read(rover), "front_left")[1] == pytest.approx(0.75 * 1.4 / 2.0)
    assert centre(read(rover, track_width=1.2), "front_right")[1] == pytest.approx(-0.6)


def with_wheels(*wheels: Wheel) -> Rover:
    return dataclasses.replace(load_rover("four_wheel_rover"), wheels=wheels)


def test_wheels_that_share_a_side_stand_beside_each_other() -> None:
    sides = [(axle, side) for axle in (0, 1) for side in ("left", "right") for _ in range(2)]
    rover = with_wheels(*(Wheel(f"w{n}", *place) for n, place in enumerate(sides)))
    robot = read(rover, track_width=1.0)
    assert [centre(robot, f"w{n}")[1] for n in range(4)] == pytest.approx(
        [0.5, 0.356, -0.5, -0.356]
    )


def named(*names: str) -> Rover:
    places = ((0, "left"), (0, "right"), (1, "left"), (1, "right"))
    return with_wheels(*(Wheel(name, *place) for name, place in zip(names, places, strict=True)))


def test_a_rigid_rover_may_call_its_wheels_as_others_their_joints() -> None:
    assert read(named("a", "b", "bogie", "rocker")).validate()


def test_a_name_that_xml_does_not_take_is_refused() -> None:
    with pytest.raises(ConfigError, match="characters that XML does not take"):
        to_urdf(named("a", "b", "c\x01", "d"))


def test_two_parts_of_one_name_and_wheels_without_room_are_refused() -> None:
    rover = load_rover("mars_rover")
    with pytest.raises(ConfigError, match="bogie_link would be the name of two parts"):
        to_urdf(rover, body_frame="bogie_link")
    twins = [Wheel(f"w{n}", n // 2 % 2, "left") for n in range(4)]
    with pytest.raises(ConfigError, match=r"a track width of 0.2 m has no room"):
        to_urdf(with_wheels(*twins), track_width=0.2)


def test_names_are_escaped() -> None:
    rover = load_rover("four_wheel_rover")
    strange = dataclasses.replace(rover.wheels[0], name='<"&>')
    assert '<"&>' in read(with_wheels(strange, *rover.wheels[1:])).actuated_joint_names
