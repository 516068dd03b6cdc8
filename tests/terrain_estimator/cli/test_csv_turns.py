# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a CSV file says of turns and cross slopes arrives in the messages."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from terrain_estimator.messaging.conversion import nose_up_pitch, roll_left_up
from tests.terrain_estimator.cli.csv_files import HEADER, ROVER, ROWS, mapping, messages, run

WHEELS = [
    {"name": "front", "slip": "s1", "sinkage": "z1", "wheel_rate": "w1", "steering": "d1"},
    {"name": "rear", "slip": "s2", "sinkage": "z2", "wheel_rate": "w2"},
]


def test_roll_lateral_velocity_and_yaw_rate_arrive_beside_the_pitch(tmp_path: Path) -> None:
    signals = {
        "roll": {"column": "roll", "unit": "deg"},
        "lateral_velocity": {"column": "left", "unit": "cm/s", "noise": {"absolute": 0.1}},
        "yaw_rate": {"column": "turn", "unit": "deg/s", "noise": {"relative": 0.1}},
    }
    lines = [f"{HEADER},roll,left,turn", f"{ROWS[0]},-12,0.5,-3", f"{ROWS[1]},,,"]
    assert run(tmp_path, mapping(**signals), lines) == 0
    first, second = messages(tmp_path / "bag", "/odom")
    imu = messages(tmp_path / "bag", "/imu")[0]
    for orientation in (first.pose.pose.orientation, imu.orientation):
        assert roll_left_up(orientation) == pytest.approx(-math.radians(12.0))
        assert nose_up_pitch(orientation) == pytest.approx(-math.radians(2.0))
    assert first.twist.twist.linear.y == pytest.approx(0.005)
    assert first.twist.covariance[7] == pytest.approx(0.001**2)
    assert first.twist.twist.angular.z == pytest.approx(-math.radians(3.0))
    assert first.twist.covariance[35] == pytest.approx(math.radians(0.3) ** 2)
    assert roll_left_up(second.pose.pose.orientation) == 0.0
    assert (second.twist.twist.linear.y, second.twist.twist.angular.z) == (0.0, 0.0)
    assert (second.twist.covariance[7], second.twist.covariance[35]) == (-1.0, -1.0)


def test_a_lateral_velocity_needs_its_noise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = mapping(lateral_velocity={"column": "v", "unit": "m/s"})
    assert run(tmp_path, content) == 2
    assert "lateral_velocity" in capsys.readouterr().err


def test_a_steering_angle_arrives_as_the_joint_of_its_wheel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [f"{HEADER},d1", f"{ROWS[0]},-20", f"{ROWS[1]},"]
    content = mapping(wheels=WHEELS, steering={"unit": "deg"}, torque=None)
    assert run(tmp_path, content, lines) == 0
    first, second = messages(tmp_path / "bag", "/joint_states")
    assert first.name == ["front", "rear", "middle", "front_steering"]
    output = capsys.readouterr().out
    assert "model_by_wheel --steered front\n" in output
    assert "a model by wheel needs roll, lateral_velocity, yaw_rate, too" in output
    np.testing.assert_allclose(first.position, [math.nan] * 3 + [-math.radians(20.0)])
    np.testing.assert_allclose(first.velocity, [2 * math.pi, 2 * math.pi, math.nan, math.nan])
    assert math.isnan(second.position[3])


def test_a_steering_angle_stands_behind_the_bogie(tmp_path: Path) -> None:
    lines = [f"{HEADER},d1", *(f"{row},10" for row in ROWS)]
    bogie = {"column": "p", "unit": "deg", "positive": "nose_up"}
    content = mapping(wheels=WHEELS, steering={"unit": "deg"}, torque=None, bogie_angle=bogie)
    assert run(tmp_path, content, lines) == 0
    [first, *_] = messages(tmp_path / "bag", "/joint_states")
    assert first.name[3:] == ["bogie", "front_steering"]
    np.testing.assert_allclose(first.position[3:], np.radians([2.0, 10.0]))


@pytest.mark.parametrize(
    ("changes", "angle", "words"),
    [
        (
            {"wheels": WHEELS, "torque": None},
            "1",
            "steering: the wheels have columns, but their unit is missing",
        ),
        ({"steering": {"unit": "deg"}}, "1", "steering: no wheel has a column for it"),
        (
            {"wheels": WHEELS, "torque": None, "steering": {"unit": "rad"}},
            "10",
            "column 'd1': steering is 10 rad in the median, further than a wheel is steered",
        ),
    ],
)
def test_a_wrong_steering_angle_is_named(
    changes: dict[str, object], angle: str, words: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    lines = [f"{HEADER},d1", *_rows(angle)]
    assert run(tmp_path, mapping(**changes), lines) == 2
    assert words in capsys.readouterr().err


def _rows(*more: str, velocity: float = 0.36, rates: str = "62,62") -> list[str]:
    """Return ten rows of a rover whose wheels turn with 0.1 m/s and slip by a tenth."""
    return [
        ",".join([f"{1 + 0.1 * k:.1f}", f"{velocity:g},2,0.1,10,10,12,11,{rates},5,6", *more])
        for k in range(10)
    ]


VELOCITY = {"column": "v", "unit": "m/s", "noise": {"absolute": 0.002}}
YAW_RATE = {"column": "w", "unit": "rad/s", "noise": {"absolute": 0.003}}
SIDES = [
    {"name": name, "axle": axle, "side": side}
    for axle, (name, side) in enumerate((("front", "left"), ("middle", "left"), ("rear", "right")))
]


@pytest.mark.parametrize(
    ("velocity", "rates", "code"),
    [
        (0.36, "62,62", 2),  # km/h, told as m/s
        (0.00001, "62,62", 0),  # explained by no unit
        (0.36, "62,20", 0),
        (0.0, "62,-62", 0),
        (0.0, "62,62", 0),
    ],
)
def test_the_hubs_of_a_rover_that_turns_may_move_otherwise_than_its_body(
    velocity: float, rates: str, code: int, tmp_path: Path
) -> None:
    """Front wheels are left, rear ones right: different rates are a turn."""
    lines = [f"{HEADER},w", *_rows("0.5", velocity=velocity, rates=rates)]
    rover = tmp_path / "sides.yaml"
    rover.write_text(yaml.safe_dump(ROVER | {"wheels": SIDES}), encoding="utf-8")
    content = mapping(velocity=VELOCITY, yaw_rate=YAW_RATE)
    assert run(tmp_path, content, lines, str(rover)) == code


def test_a_yaw_rate_does_not_hide_a_wrong_unit_of_the_velocity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [f"{HEADER},w", *_rows("0.003", velocity=0.1)]
    assert run(tmp_path, mapping(yaw_rate=YAW_RATE), lines) == 2
    assert "set velocity.unit: m/s" in capsys.readouterr().err
