# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""CSV files become bags of input messages, or a clear error."""

import errno
import math
import os
import re
import subprocess
import sys
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

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"

ARABIC = "\u0660.\u0663"  # 0.3, which Python's float takes
HEADER = "t,v,p,a,s1,s2,z1,z2,w1,w2,q1,q2"
ROVER = {
    "name": "tricycle",
    "mass": 3.0,
    "gravity": 9.81,
    "wheel_radius": 0.017,
    "wheel_width": 0.02,
    "wheel_inertia": 0.0,
    "axle_x": [0.2, 0.0, -0.2],
    "centre_of_mass_x": 0.0,
    "centre_of_mass_height": 0.1,
    "bogie_pivot_x": -0.1,
    "bogie_pivot_height": 0.1,
    "cruise_speed": [0.05, 0.15],
    "sinkage_noise_floor": 0.0005,
    "wheels": [
        {"name": name, "axle": axle, "side": "left"}
        for axle, name in enumerate(("front", "middle", "rear"))
    ],
}
"""The middle wheel is not measured: the mapping leaves it out."""
ROWS = ["0.5,100,2,0.1,10,-20,12,11,60,60,5,6", "0.6,101,2,0.1,20,30,,10,60,30,7,8"]


def mapping(**changes: Any) -> dict[str, Any]:
    """Return a mapping of two wheels; a change to None removes a key."""
    whole: dict[str, Any] = {
        "time": {"column": "t"},
        "slip_definition": "max_normalised",
        "wheels": [
            {"name": "front", "slip": "s1", "sinkage": "z1", "wheel_rate": "w1", "torque": "q1"},
            {"name": "rear", "slip": "s2", "sinkage": "z2", "wheel_rate": "w2", "torque": "q2"},
        ],
        "slip": {"unit": "%", "noise": {"relative": 0.05, "absolute": 1.0}},
        "sinkage": {"unit": "mm", "noise": {"relative": 0.1, "absolute": 0.5}},
        "constant_contact_angle": {"value": 1.0, "unit": "deg", "noise": {"absolute": 0.5}},
        "wheel_rate": {"unit": "rpm"},
        "torque": {"unit": "N cm", "noise": {"relative": 0.03, "absolute": 10.0}},
        "velocity": {"column": "v", "unit": "mm/s", "noise": {"absolute": 2.0}},
        "pitch": {
            "column": "p",
            "unit": "deg",
            "positive": "nose_down",
            "noise": {"absolute": 0.5},
        },
        "acceleration": {"column": "a", "unit": "g", "noise": {"absolute": 0.01}},
    }
    return {key: value for key, value in {**whole, **changes}.items() if value is not None}


def run(
    folder: Path, content: dict[str, Any], lines: list[str] | None = None, rover: str = ""
) -> int:
    """Run csv_to_bag on files in a folder; the bag is folder/bag."""
    (folder / "rover.yaml").write_text(yaml.safe_dump(ROVER), encoding="utf-8")
    (folder / "map.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    (folder / "data.csv").write_text(
        "\n".join([HEADER, *ROWS] if lines is None else lines), encoding="utf-8"
    )
    return main(
        [
            str(folder / "data.csv"),
            "--mapping",
            str(folder / "map.yaml"),
            "--out",
            str(folder / "bag"),
            "--rover",
            rover or str(folder / "rover.yaml"),
        ]
    )


def messages(folder: Path, topic: str) -> list[Any]:
    with BagReader(folder) as reader:
        return [reader.decode(message) for message in reader.messages([topic])]


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


def rows(count: int, rate_hz: float = 10.0, **columns: float) -> list[str]:
    """Return a file of equal rows at a rate, in the units of the mapping."""
    row = {"v": 100.0, "p": 2.0, "a": 0.1, "s1": 10, "s2": -20, "z1": 12, "z2": 11}
    row |= {"w1": 62, "w2": 45, "q1": 5, "q2": 6} | columns
    values = ",".join(f"{row[name]:g}" for name in HEADER.split(",")[1:])
    return [HEADER, *(f"{1 + step / rate_hz:.6f},{values}" for step in range(count))]


@pytest.mark.parametrize(
    ("changes", "columns", "words"),
    [
        (
            {"slip": {"unit": "1", "noise": {"absolute": 0.01}}, "slip_definition": None},
            {},
            "slip is 10 in the median, above 1, that of a wheel that spins on the spot: set",
        ),
        (
            {"slip_definition": None},
            {"s1": 0.1, "s2": -0.2},
            "slip: the velocity and the wheel rates give",
        ),
        (
            {"sinkage": {"unit": "m", "noise": {"absolute": 0.01}}},
            {},
            "sinkage is 12 m in the median, above the wheel radius 0.017 m: set sinkage.unit: mm",
        ),
        (
            {"velocity": {"column": "v", "unit": "m/s", "noise": {"absolute": 2.0}}},
            {"v": 0.36},
            "times that of the wheels, r w (1 - slip) with r = 0.017 m: set velocity.unit: km/h",
        ),
        (
            {"wheel_rate": {"unit": "rad/s"}},
            {},
            "or wheel_rate.unit: rpm in the mapping, or give the right rover",
        ),
        ({}, {"w1": 372, "w2": 270}, "set wheel_rate.unit: deg/s in the mapping"),
        ({}, {"w1": -62, "w2": -45}, "velocity and wheel_rate have opposite signs"),
        (
            {
                "pitch": {
                    "column": "p",
                    "unit": "rad",
                    "positive": "nose_up",
                    "noise": {"absolute": 0.5},
                }
            },
            {},
            "column 'p': pitch is 2 rad in the median, steeper than a wall: set pitch.unit: deg",
        ),
        ({}, {"a": 9.8}, "column 'a': acceleration is 9.8 g in the median, above three times"),
        (
            {"torque": {"unit": "N m", "noise": {"absolute": 1}}},
            {},
            "column 'q1': torque is 5 N m in the median",
        ),
    ],
)
def test_impossible_values_name_column_value_and_the_unit_that_fits(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, Any],
    columns: dict[str, float],
    words: str,
) -> None:
    assert run(tmp_path, mapping(), rows(20)) == 0, capsys.readouterr().err
    (tmp_path / "bag").rename(tmp_path / "plain")
    assert run(tmp_path, mapping(**changes), rows(20, **columns)) == 2
    assert words in (error := capsys.readouterr().err), error
    assert not (tmp_path / "bag").exists()


def test_a_single_impossible_value_is_left_to_the_estimator(tmp_path: Path) -> None:
    lines = rows(20)
    lines[7] = lines[7].replace(",12,", ",12000,")
    assert run(tmp_path, mapping(), lines) == 0


def test_decimal_commas_and_words_for_missing_values(tmp_path: Path) -> None:
    lines = [line.replace(",", ";").replace(".", ",") for line in [HEADER, *ROWS]]
    lines[2] = lines[2].replace(";;", ";n/a;")
    assert run(tmp_path, mapping(delimiter=";", decimal=",", missing=["n/a", "-"]), lines) == 0
    first, second = messages(tmp_path / "bag", "/wheel_sinkage")
    assert first.sinkage[0] == 0.012
    assert math.isnan(second.sinkage[0])
    assert messages(tmp_path / "bag", "/imu")[0].linear_acceleration.x == pytest.approx(0.980665)


def test_the_rate_is_found_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path, mapping(), rows(100, 50.0)) == 0
    assert "100 rows at 50 Hz, averaged to 10 Hz" in capsys.readouterr().out
    (tmp_path / "bag").rename(tmp_path / "fast")
    assert run(tmp_path, mapping(), rows(20)) == 0
    assert "20 rows at 10 Hz\n" in capsys.readouterr().out
    assert run(tmp_path, mapping(), rows(20, 2.0)) == 2
    assert "column 't': the rows come at 2 Hz, but 5 to 200 Hz" in capsys.readouterr().err


def test_a_wheel_without_columns_is_not_measured_and_an_axle_without_any_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, mapping()) == 0
    assert "slip: no column for middle: without a whole axle every" in capsys.readouterr().out


def test_a_reader_who_wants_one_line_gets_it(tmp_path: Path) -> None:
    assert run(tmp_path, mapping(), rows(20)) == 0
    (tmp_path / "bag").rename(tmp_path / "other")
    command = (
        f"set -o pipefail; {sys.executable} -m terrain_estimator.cli.csv_to_bag {tmp_path}/data.csv"
        f" --mapping {tmp_path}/map.yaml --rover {tmp_path}/rover.yaml --out {tmp_path}/bag"
        " | (exec 0<&-)"
    )
    result = subprocess.run(["bash", "-c", command], check=False, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "bag" / "metadata.yaml").exists()
