# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""CSV files become bags of input messages, or a clear error."""

import errno
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from terrain_estimator.bags import BagReader, BagWriter
from terrain_estimator.bags.writing.part import BagTopic
from terrain_estimator.cli.csv_to_bag import main
from terrain_estimator.console.interrupting import INTERRUPTED
from terrain_estimator.importing.samples import MeasuredValue, slip_from_max_normalised
from terrain_estimator.messaging.conversion import nose_up_pitch
from tests.terrain_estimator.cli.csv_files import HEADER, ROVER, ROWS, mapping, messages, run

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"

ARABIC = "\u0660.\u0663"  # 0.3, which Python's float takes


def test_every_signal_arrives_in_si_units(tmp_path: Path) -> None:
    assert run(tmp_path, mapping()) == 0
    bag = tmp_path / "bag"
    slip, sinkage, odom, joints, imu = (
        messages(bag, f"/{name}")[0]
        for name in ("wheel_slip", "wheel_sinkage", "odom", "joint_states", "imu")
    )
    assert (slip.header.stamp.sec, slip.header.stamp.nanosec, slip.header.frame_id) == (
        0,
        500_000_000,
        "base_link",
    )
    unknown = math.nan  # the wheel that the mapping leaves out
    assert slip.wheel == ["front", "rear", "middle"]
    # driving as it is, braking -0.2 / 0.8
    np.testing.assert_allclose(slip.slip, [0.1, -0.25, unknown])
    np.testing.assert_allclose(
        slip.slip_stddev, [math.hypot(0.005, 0.01), math.hypot(0.01, 0.01) / 0.8**2, unknown]
    )
    assert sinkage.reference == "undisturbed"
    assert slip.lateral_slip.size == slip.slip_angle.size == 0
    np.testing.assert_allclose(sinkage.sinkage, [0.012, 0.011, unknown])
    np.testing.assert_allclose(
        sinkage.sinkage_stddev, [math.hypot(0.0012, 0.0005), math.hypot(0.0011, 0.0005), unknown]
    )
    np.testing.assert_allclose(sinkage.contact_angle, [math.radians(1.0)] * 3)
    np.testing.assert_allclose(joints.velocity, [2 * math.pi, 2 * math.pi, unknown])
    np.testing.assert_allclose(joints.effort, [0.05, 0.06, unknown])
    assert odom.child_frame_id == "base_link"
    assert odom.twist.twist.linear.x == pytest.approx(0.1)
    assert odom.twist.covariance[0] == pytest.approx(0.002**2)
    assert imu.linear_acceleration.x == pytest.approx(0.980665)
    assert imu.linear_acceleration_covariance[0] == pytest.approx(0.0980665**2)
    assert imu.orientation_covariance[4] == pytest.approx(math.radians(0.5) ** 2)
    assert nose_up_pitch(imu.orientation) == pytest.approx(-math.radians(2.0))
    assert nose_up_pitch(odom.pose.pose.orientation) == pytest.approx(-math.radians(2.0))


def test_an_empty_cell_is_a_value_that_was_not_measured(tmp_path: Path) -> None:
    assert run(tmp_path, mapping()) == 0
    sinkage = messages(tmp_path / "bag", "/wheel_sinkage")[1]
    assert math.isnan(sinkage.sinkage[0])
    assert math.isnan(sinkage.sinkage_stddev[0])
    assert sinkage.sinkage[1] == 0.01


def test_the_ground_that_sinkages_are_from_is_written(tmp_path: Path) -> None:
    for changes, said in (({}, "undisturbed"), ({"sinkage_reference": "local"}, "local")):
        folder = tmp_path / said
        folder.mkdir()
        assert run(folder, mapping(**changes)) == 0
        found = messages(folder / "bag", "/wheel_sinkage")
        assert {each.reference for each in found} == {said}


def test_a_signal_that_was_not_measured_is_absent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wheels = [{"name": "front", "slip": "s1", "sinkage": "z1"}, {"name": "rear", "slip": "s2"}]
    absent = dict.fromkeys(
        ("torque", "wheel_rate", "pitch", "acceleration", "constant_contact_angle")
    )
    assert run(tmp_path, mapping(wheels=wheels, **absent)) == 0
    with BagReader(tmp_path / "bag") as reader:
        assert set(reader.topics) == {"/wheel_slip", "/wheel_sinkage", "/odom"}
    assert math.isnan(messages(tmp_path / "bag", "/wheel_sinkage")[0].sinkage[1])
    assert math.isnan(nose_up_pitch(messages(tmp_path / "bag", "/odom")[0].pose.pose.orientation))
    output = capsys.readouterr().out
    assert "not in the data: torque, acceleration, bogie_angle" in output
    assert "no pitch: give a column, or constant_pitch" in output


def test_a_file_without_velocity_is_told_that_nothing_can_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, mapping(velocity=None)) == 0
    assert "no velocity: every observation is refused: give its column" in capsys.readouterr().out


def test_a_bogie_angle_arrives_as_a_joint_nose_up(tmp_path: Path) -> None:
    """Use the column of the pitch: 2 deg nose down."""
    assert (
        run(tmp_path, mapping(bogie_angle={"column": "p", "unit": "deg", "positive": "nose_down"}))
        == 0
    )
    [first, *_] = messages(tmp_path / "bag", "/joint_states")
    assert first.name == ["front", "rear", "middle", "bogie"]
    assert first.position[3] == pytest.approx(-math.radians(2.0))
    np.testing.assert_allclose(first.velocity, [2 * math.pi, 2 * math.pi, math.nan, math.nan])
    np.testing.assert_allclose(first.effort, [0.05, 0.06, math.nan, math.nan])


def test_a_rover_without_a_joint_neither_has_nor_misses_a_bogie_angle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wheels = [{"name": name, "axle": axle} for axle, name in enumerate(("front", "rear"))]
    rover = {key: value for key, value in ROVER.items() if "bogie" not in key}
    rover |= {"axle_x": [0.2, -0.2], "wheels": wheels}
    path = tmp_path / "two_axles.yaml"
    path.write_text(yaml.safe_dump(rover, sort_keys=False), encoding="utf-8")
    angle = {"column": "p", "unit": "deg", "positive": "nose_down"}
    assert run(tmp_path, mapping(bogie_angle=angle), rover=str(path)) == 2
    assert "bogie_angle: the rover tricycle has no joint: leave it out" in capsys.readouterr().err
    assert run(tmp_path, mapping(), rover=str(path)) == 0
    assert messages(tmp_path / "bag", "/joint_states")[0].name == ["front", "rear"]
    assert "bogie_angle" not in capsys.readouterr().out


def test_contact_angles_against_the_horizontal_are_turned_into_those_relative_to_the_body(
    tmp_path: Path,
) -> None:
    """The body is 2 deg nose down on ground that climbs by 1 deg, 3 deg relative to the body."""
    assert run(tmp_path, mapping(contact_angle_reference="horizontal")) == 0
    sinkage = messages(tmp_path / "bag", "/wheel_sinkage")[0]
    np.testing.assert_allclose(sinkage.contact_angle, [math.radians(3.0)] * 3)
    np.testing.assert_allclose(sinkage.contact_angle_stddev, [math.radians(math.sqrt(0.5))] * 3)


def test_without_a_pitch_an_angle_against_the_horizontal_is_not_measured(tmp_path: Path) -> None:
    rows = ["0.5,100,,0.1,10,-20,12,11,60,60,5,6"]
    changes = {"contact_angle_reference": "horizontal"}
    assert run(tmp_path, mapping(**changes), [HEADER, *rows]) == 0
    assert np.isnan(messages(tmp_path / "bag", "/wheel_sinkage")[0].contact_angle).all()


def test_an_imu_says_which_of_its_parts_was_not_measured(tmp_path: Path) -> None:
    assert run(tmp_path, mapping(pitch=None)) == 0
    [first, *_] = messages(tmp_path / "bag", "/imu")
    assert first.orientation_covariance[0] == -1.0
    assert first.linear_acceleration_covariance[0] > 0.0


def test_the_bag_says_where_it_comes_from(tmp_path: Path) -> None:
    assert run(tmp_path, mapping()) == 0
    with BagReader(tmp_path / "bag") as reader:
        record = reader.metadata["csv_to_bag"]
    assert record["file"] == "data.csv"
    assert len(record["sha256"]) == 64
    assert yaml.safe_load(record["mapping"])["slip_definition"] == "max_normalised"


def test_the_example_of_the_documentation_converts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    assert (
        main(
            [
                str(EXAMPLES / "field_run.csv"),
                "--mapping",
                str(EXAMPLES / "field_run.yaml"),
                "--out",
                str(bag),
            ]
        )
        == 0
    )
    with BagReader(bag) as reader:
        assert {topic.count for topic in reader.topics.values()} == {12}
        assert len(reader.topics) == 5
    assert "-p torque_noise.relative:=0.03 -p torque_noise.absolute:=0.2" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"extra": 1}, "unknown key 'extra'"),
        ({"slip": {"unit": "%", "noize": {}}}, "slip: unknown key 'noize'"),
        ({"slip": {"unit": "%", "noise": {"relativ": 0.1}}}, "slip: noise: unknown key 'relativ'"),
        ({"wheels": [{"name": "front", "slipp": "s1"}]}, r"wheels\[0\]: unknown key 'slipp'"),
        (
            {"slip": {"unit": "percent", "noise": {"absolute": 1}}},
            "slip: unknown unit 'percent' of ratio: give one of 1, %",
        ),
        ({"time": {"column": "t", "unit": "min"}}, "unknown unit 'min' of time"),
        ({"time": None}, "missing key 'time'"),
        ({"slip": {"unit": "%"}}, "slip: its noise is missing"),
        ({"slip": None}, "slip: the wheels have columns, but their unit is missing"),
        (
            {"sinkage": {"unit": "mm", "noise": {"absolute": -1.0}}},
            "sinkage: noise: absolute: -1 is outside its range",
        ),
        (
            {"contact_angle": {"unit": "deg", "noise": {"absolute": 1}}},
            "contact_angle: no wheel has a column for it",
        ),
        (
            {"constant_pitch": {"value": 0.0, "unit": "deg", "noise": {"absolute": 1}}},
            "constant_pitch: it is both a constant and a column",
        ),
        (
            {"constant_contact_angle": {"value": 0.0, "unit": "deg"}},
            "constant_contact_angle: its noise is missing",
        ),
        (
            {"pitch": {"column": "p", "unit": "deg", "noise": {"absolute": 1}}},
            "pitch: positive: '', expected nose_up or nose_down",
        ),
        (
            {"slip_definition": "wong"},
            "slip_definition: 'wong' is unknown: give one of one_minus_v_over_rw, max_normalised",
        ),
        (
            {"sinkage_reference": "Local"},
            "sinkage_reference: 'Local' is unknown: give undisturbed, for ground where no wheel",
        ),
        (
            {"contact_angle_reference": "gravity"},
            "contact_angle_reference: 'gravity' is unknown: give one of body, horizontal",
        ),
        (
            {"contact_angle_reference": "horizontal", "pitch": None},
            "contact_angle_reference: horizontal needs the pitch of the body: give pitch or",
        ),
        (
            {"wheels": [{"name": "front", "slip": "s1"}, {"name": "front"}]},
            "wheels: a name is given twice",
        ),
        ({"decimal": "'"}, 'decimal: "\'" is no decimal mark: give . or ,'),
        ({"decimal": ","}, "decimal: ',' is also the delimiter: set delimiter"),
        (
            {"wheels": [{**mapping()["wheels"][0], "name": "frnt"}]},
            r"wheels\[0\]: name: 'frnt' is no wheel of the rover tricycle: did you mean front",
        ),
        ({"delimiter": ";;"}, "delimiter: ';;' is not one character"),
        (
            {"velocity": {"column": "p", "unit": "mm/s", "noise": {"absolute": 2.0}}},
            "column 'p' is named for velocity and for pitch",
        ),
        ({"time": {"column": "w1"}}, "column 'w1' is named for time and for wheel_rate"),
    ],
)
def test_a_wrong_mapping_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, Any], words: str
) -> None:
    assert run(tmp_path, mapping(**changes)) == 2
    error = capsys.readouterr().err
    assert str(tmp_path / "map.yaml") in error
    assert re.search(words, error), error
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "is empty: the first row must name the columns"),
        ([HEADER], "has no data below row 1"),
        ([HEADER.replace("s1", "slip"), *ROWS], "row 1: no column 's1'; the file has t, v, p"),
        ([HEADER + ",t", *(row + ",1" for row in ROWS)], "row 1: column 't' appears twice"),
        ([HEADER, ROWS[0] + ",7"], "row 2: 13 cells, but 12 columns are named"),
        (
            [HEADER, ROWS[0].replace("10,-20", "ten,-20")],
            "row 2, column 's1': 'ten' is not a number",
        ),
        (
            [HEADER, ROWS[0].replace("10,-20", "nan,-20")],
            "row 2, column 's1': 'nan' is not finite: leave the cell empty",
        ),
        (
            [HEADER, ROWS[0], ROWS[1].replace("101", "-inf")],
            "row 3, column 'v': '-inf' is not finite",
        ),
        (
            [HEADER, ROWS[0], ROWS[0]],
            "row 3, column 't': '0.5' is not later than in the row before",
        ),
        (
            [HEADER, ROWS[1], ROWS[0]],
            "row 3, column 't': '0.5' is not later than in the row before",
        ),
        (
            [HEADER, ROWS[0].replace("0.5", "", 1)],
            "row 2, column 't': '' is empty: every row needs its time",
        ),
        (
            [HEADER, ROWS[0].replace("0.5", "-1", 1)],
            "row 2, column 't': '-1' with offset 0 s is outside 0 to",
        ),
        (
            [HEADER, ROWS[0].replace("10,-20", "10,-120")],
            "row 2, column 's2': '-120' is outside -1 to 1",
        ),
        ([HEADER, '0.5,"100'], "is not a CSV file"),
        ([HEADER, ROWS[0].replace("0.5", "1e308", 1)], "'1e308' with offset 0 s is outside 0 to"),
        ([HEADER, ROWS[0].replace("0.1", "0_0.3", 1)], "column 'a': '0_0.3' is not a number"),
        ([HEADER, ROWS[0].replace("0.1", ARABIC, 1)], f"column 'a': '{ARABIC}' is not a number"),
        (
            [HEADER, ROWS[0].replace("10,-20", '"1,5",-20')],
            "'1,5' is not a number: set decimal: \",\" in the mapping",
        ),
        (
            [HEADER, ROWS[0].replace("10,-20", "n/a,-20")],
            "where nothing was measured, or list the word under missing in the mapping",
        ),
    ],
)
def test_a_wrong_file_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lines: list[str], words: str
) -> None:
    assert run(tmp_path, mapping(), lines) == 2
    error = capsys.readouterr().err
    assert str(tmp_path / "data.csv") in error
    assert words in error
    assert not (tmp_path / "bag").exists()


def test_an_existing_bag_is_never_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bag").mkdir()
    assert run(tmp_path, mapping()) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping()))
    (tmp_path / "rover.yaml").write_text(yaml.safe_dump(ROVER))
    assert (
        main(
            [
                str(tmp_path / "no.csv"),
                "--mapping",
                str(tmp_path / "map.yaml"),
                "--out",
                str(tmp_path / "bag"),
                "--rover",
                str(tmp_path / "rover.yaml"),
            ]
        )
        == 2
    )
    assert "no.csv cannot be read: No such file" in capsys.readouterr().err


@given(rim_speed=st.floats(1e-3, 10.0), velocity=st.floats(1e-3, 10.0))
def test_slip_of_either_definition_is_one_minus_v_over_rw(
    rim_speed: float, velocity: float
) -> None:
    normalised = (rim_speed - velocity) / max(rim_speed, velocity)
    converted = slip_from_max_normalised(MeasuredValue(normalised, 0.01))
    assert converted.value == pytest.approx(1.0 - velocity / rim_speed, rel=1e-9, abs=1e-12)


@given(slip=st.floats(-0.95, -1e-3) | st.floats(1e-3, 0.95))
def test_the_deviation_of_slip_follows_its_derivative(slip: float) -> None:
    step = 1e-6
    above, below = (
        slip_from_max_normalised(MeasuredValue(slip + sign * step, 0.0)).value for sign in (1, -1)
    )
    converted = slip_from_max_normalised(MeasuredValue(slip, 0.01))
    assert converted.deviation == pytest.approx(0.01 * (above - below) / (2 * step), rel=1e-4)


def test_a_locked_wheel_has_no_slip() -> None:
    assert math.isnan(slip_from_max_normalised(MeasuredValue(-1.0, 0.01)).value)


@pytest.mark.parametrize(
    "ended_by", [OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), KeyboardInterrupt()]
)
def test_a_bag_that_is_not_written_to_its_end_is_taken_back(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    ended_by: BaseException,
) -> None:
    write = BagWriter.write

    def fail(self: BagWriter, topic: BagTopic, *rest: Any) -> None:
        if topic.count.count:
            raise ended_by
        write(self, topic, *rest)

    monkeypatch.setattr(BagWriter, "write", fail)
    if isinstance(ended_by, OSError):
        assert run(tmp_path, mapping()) == 2
        assert (
            f"{tmp_path / 'bag'}: cannot be written (No space left on device)"
            in capsys.readouterr().err
        )
    else:
        assert run(tmp_path, mapping()) == INTERRUPTED
        assert capsys.readouterr().err == "csv_to_bag: interrupted\n"
    assert {path.name for path in tmp_path.iterdir()} == {"map.yaml", "data.csv", "rover.yaml"}
