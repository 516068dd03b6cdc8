# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile trials: an error names file, row, column, value and what to do, or all of it is read."""

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rover_parameters.records import ConfigError
from terrain_estimator.bags import BagError
from terrain_estimator.importing.rose.doubts import doubts, faults
from terrain_estimator.importing.rose.recording import read_recording
from terrain_estimator.importing.rose.samples import find
from terrain_estimator.importing.rose.schema import RoseOptions, wheel_order
from terrain_estimator.importing.rose.table import read_table
from terrain_estimator.importing.samples import CsvError
from terramechanics.presets import load_rover
from tests.terrain_estimator.importing.rose_trial import (
    HEADER,
    ROVER,
    TRACK,
    driven,
    rows,
    write_recording,
    write_table,
)

OPTIONS = RoseOptions(track_width=TRACK, torque_gain=1.0, torque_sd=0.1)
WITH_FIELDS = RoseOptions(track_width=TRACK, rate_fields=("speeds",))
Table = list[list[float]]
Change = Callable[[Table], object]


@cache
def some_rows() -> list[tuple[float, ...]]:
    """Return two seconds of a drive."""
    return [tuple(row) for row in rows(driven())[300:540]]


def table(path: Path, change: Change = lambda _: None, header: list[str] = HEADER) -> Path:
    found = [list(row) for row in some_rows()]
    change(found)
    return write_table(path / "Processed_Data.csv", found, header)


def put(row: int, column: str, value: object) -> Change:
    def change(found: Table) -> None:
        found[row][HEADER.index(column)] = value  # type: ignore[call-overload]

    return change


def swapped(found: Table) -> None:
    found[7], found[8] = found[8], found[7]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put(3, "pos_x", "1,5"), r"row 5, column 'pos_x': '1,5' is no number: correct it, or"),
        (put(3, "pos_x", "1_000"), r"row 5, column 'pos_x': '1_000' is no number"),
        (put(3, "vel2_rad_s", "1e400"), r"row 5, column 'vel2_rad_s': '1e400' cannot be: correct"),
        (put(3, "vel2_rad_s", "-inf"), r"row 5, column 'vel2_rad_s': '-inf' cannot be"),
        (put(3, "pos_z", 1e9), r"row 5, column 'pos_z': '1000000000.0' cannot be"),
        (put(3, "time_s", ""), r"row 5, column 'time_s': '' is empty: every row needs its time"),
        (put(3, "time_s", -1), r"row 5, column 'time_s': '-1' is outside 0 to 2147483647 s"),
        (put(3, "time_s", "1e300"), r"row 5, column 'time_s': '1e300' is outside 0 to"),
        (put(3, "quat_w", 0.2), r"row 5, column 'quat_x': .* has length 0.2.* correct quat_x"),
        (swapped, r"row 10, column 'time_s': .* earlier than that of a row before: sort"),
        (
            lambda found: found.insert(8, [found[7][0], *found[9][1:]]),
            r"row 10, column 'time_s': .* equal to that of a row before: sort or remove",
        ),
        (lambda found: found[5].pop(), r"row 7: 29 cells, but 30 columns .* copy the file again"),
        (lambda found: found[5].append(1), r"row 7: 31 cells, but 30 columns"),
        (lambda found: found.clear(), r"has no data below row 1"),
    ],
)
def test_what_is_wrong_in_a_row_is_named(tmp_path: Path, change: Change, words: str) -> None:
    with pytest.raises(CsvError, match=rf"Processed_Data.csv.* ?{words}"):
        read_table(table(tmp_path, change), OPTIONS)


@pytest.mark.parametrize("name", ["time_s", "pos_y", "quat_w", "vel4_rad_s", "current1"])
def test_a_missing_or_doubled_column_is_named_with_the_option_that_maps_it(
    tmp_path: Path, name: str
) -> None:
    header = [f"my_{each}" if each == name else each for each in HEADER]
    with pytest.raises(CsvError, match=rf"no column '{name}'.* give --column {name}=NAME"):
        read_table(table(tmp_path, header=header), OPTIONS)
    mapped = RoseOptions(
        track_width=TRACK, torque_gain=1.0, torque_sd=0.1, columns={name: f"my_{name}"}
    )
    assert len(read_table(table(tmp_path, header=header), mapped).poses.time) == 240
    with pytest.raises(CsvError, match=rf"row 1: column '{name}' appears twice"):
        read_table(
            table(tmp_path, header=[*HEADER[:-1], name]),
            RoseOptions(track_width=TRACK, columns={}, torque_gain=1.0, torque_sd=0.1),
        )


def test_columns_that_are_not_needed_need_not_be_there(tmp_path: Path) -> None:
    header = [each if not each.startswith(("current", "enc")) else f"x{each}" for each in HEADER]
    trial = read_table(table(tmp_path, header=header), RoseOptions(track_width=TRACK))
    assert np.isnan(trial.wheels.current).all()
    assert np.isfinite(trial.wheels.rate).all()


def test_what_was_not_measured_is_left_out(tmp_path: Path) -> None:
    def change(found: Table) -> None:
        put(3, "pos_x", "")(found)
        put(4, "quat_y", "NaN")(found)
        put(5, "vel3_rad_s", "nan")(found)
        found[6][4:8] = [0.0] * 4  # no attitude

    trial = read_table(table(tmp_path, change), OPTIONS)
    assert len(trial.poses.time) == 237
    assert math.isnan(trial.wheels.rate[5, 2])
    assert np.isnan(trial.wheels.rate).sum() == 1


@pytest.mark.parametrize(
    "data", [b"", b"\n\n", b"\xff\xfe\x00", b"time_s\n", b'time_s,"pos_x\n', b"\x00" * 50]
)
def test_other_files_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(data)
    with pytest.raises(CsvError, match=r"data\.csv"):
        read_table(path, OPTIONS)


def test_a_table_that_is_cut_short_is_an_error_or_all_that_is_whole(tmp_path: Path) -> None:
    whole = table(tmp_path).read_bytes()
    path, read = tmp_path / "cut.csv", 0
    for length in range(len(whole) - 400, len(whole), 7):
        path.write_bytes(whole[:length])
        try:
            read += len(read_table(path, OPTIONS).poses.time) in (238, 239, 240)
        except CsvError as error:
            assert "cut.csv, row 24" in str(error)  # noqa: PT017 (each length ends either way)
            read -= 1
    assert read < 0, "most cuts are within a row"


@settings(max_examples=60)
@given(st.data())
def test_any_damage_gives_a_trial_or_an_error_that_names_the_file(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("damage")
    text = bytearray(table(folder, lambda found: found.__delitem__(slice(60, None))).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text) - 1))
        kind = data.draw(st.sampled_from(["byte", "cut", "copy", "word"]))
        if kind == "byte":
            text[at] = data.draw(st.integers(0, 255))
        elif kind == "cut":
            del text[at : at + data.draw(st.integers(1, 200))]
        elif kind == "copy":
            text[at:at] = text[at : at + data.draw(st.integers(1, 200))]
        else:
            text[at:at] = data.draw(
                st.sampled_from([b"1e308", b"nan", b"-", b'"', b"\n", b",", b"99999999999"])
            )
        if not text:
            return
    path = folder / "data.csv"
    path.write_bytes(text)
    try:
        found = find(read_table(path, OPTIONS), ROVER, OPTIONS)
        assert all(isinstance(each, str) for each in faults(found, ROVER, OPTIONS))
        assert all(isinstance(each, str) for each in doubts(found, ROVER, OPTIONS))
    except CsvError as error:
        assert str(path) in str(error)  # noqa: PT017 (no error is right, too)
        return
    assert found.samples
    stamps = [sample.stamp_ns for sample in found.samples]
    assert stamps == sorted(set(stamps))
    for sample in found.samples:
        assert math.isfinite(sample.velocity.value)
        assert sample.velocity.deviation > 0.0
        assert all(math.isnan(each.value) or each.deviation > 0.0 for each in sample.slip)
        assert math.isfinite(sample.pitch.value)


def test_a_gap_of_years_takes_no_time(tmp_path: Path) -> None:
    def change(found: Table) -> None:
        for row in found[120:]:
            row[0] += 1e9

    found = find(read_table(table(tmp_path, change), OPTIONS), ROVER, OPTIONS)
    assert 10 < len(found.samples) < 22
    assert found.without_pose_s == pytest.approx(1e9, rel=1e-6)


def turned(found: Table) -> None:
    """Give the pose's frame another forward axis: -y."""
    for row in found:
        x, y, z, w = row[4:8]
        half = math.sqrt(0.5)  # times a quarter turn to the left about z
        row[4:8] = [half * (x + y), half * (y - x), half * (z + w), half * (w - z)]


def lying(found: Table) -> None:
    for row in found:
        x, y, z, w = row[4:8]
        half = math.sqrt(0.5)  # times a quarter turn about x
        row[4:8] = [half * (x + w), half * (y + z), half * (z - y), half * (w - x)]


def mirrored(found: Table) -> None:
    for row in found:
        row[23], row[25] = -row[23], -row[25]


def scaled(columns: slice, factor: float) -> Change:
    def change(found: Table) -> None:
        for row in found:
            row[columns] = [factor * value for value in row[columns]]

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (turned, "moves along -y of its frame: give --body-axes=-y,z"),
        (mirrored, "wheels 2 and 4 turn against wheel 1 while the rover drives straight: give"),
        (scaled(slice(22, 26), -1.0), "moves along -x of its frame: give --body-axes=-x,z, or"),
        (scaled(slice(1, 4), 1000.0), "give --position-unit mm, or give the right --rover"),
        (scaled(slice(22, 26), 1.0 / math.tau), "give --rate-unit 1/s, or give the right --rover"),
    ],
)
def test_a_trial_that_contradicts_itself_is_refused(
    tmp_path: Path, change: Change, words: str
) -> None:
    found = find(read_table(table(tmp_path, change), OPTIONS), ROVER, OPTIONS)
    (told,) = faults(found, ROVER, OPTIONS)
    assert words in told
    sound = find(read_table(table(tmp_path), OPTIONS), ROVER, OPTIONS)
    assert not [*faults(sound, ROVER, OPTIONS), *doubts(sound, ROVER, OPTIONS)]


def test_wheels_in_degrees_are_doubted_and_a_rover_that_lies_is_refused(tmp_path: Path) -> None:
    degrees = scaled(slice(22, 26), math.degrees(1.0))
    found = find(read_table(table(tmp_path, degrees), OPTIONS), ROVER, OPTIONS)
    (told,) = doubts(found, ROVER, OPTIONS)
    assert "if it is not stuck give --rate-unit deg/s" in told
    with pytest.raises(CsvError, match="does not stand upright: give the axes"):
        find(read_table(table(tmp_path, lying), OPTIONS), ROVER, OPTIONS)


def test_a_stated_deviation_that_the_lines_contradict_is_told(tmp_path: Path) -> None:
    trial = read_table(table(tmp_path), OPTIONS)
    (told,) = find(trial, ROVER, RoseOptions(track_width=TRACK, position_sd=5e-5)).notes
    assert told.startswith(
        ("the positions miss their lines by 0.19", "the positions miss their lines by 0.2")
    )
    assert "more than --position-sd 0.05 mm: give a larger one" in told
    assert not find(trial, ROVER, RoseOptions(track_width=TRACK, position_sd=2e-4)).notes


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({}, "give --track-width"),
        ({"track_width": 0.5, "torque_gain": 1.0}, "--torque-gain and --torque-sd"),
        ({"track_width": 0.5, "torque_sd": 0.1}, "--torque-gain and --torque-sd"),
        (
            {"track_width": 0.5, "acceleration_axis": "x"},
            "--acceleration-axis and --acceleration-sd",
        ),
        ({"track_width": 0.5, "body_axes": ("x", "-x")}, "give two different axes"),
        ({"track_width": 0.5, "columns": {"torque": "t"}}, "the schema has no column torque"),
    ],
)
def test_statements_that_do_not_fit_together_are_refused(
    stated: dict[str, object], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        RoseOptions(**stated)  # type: ignore[arg-type]


def test_each_wheel_of_the_rover_has_its_column() -> None:
    assert wheel_order(ROVER) == [0, 1, 2, 3]
    with pytest.raises(ConfigError, match="two axles with a wheel left and right"):
        wheel_order(load_rover("mars_rover"))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("raw") / "raw", driven())


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ((), r"give the field .* by --rate-fields; the message has header, speeds, load_a"),
        (("speed",), r"--rate-fields: no field 'speed'; the message has header, speeds"),
        (("load_a", "load_b"), r"or four fields with commas, by --rate-fields"),
        (("remark",), r"is not one number for each of the four wheels"),
        (("load_a",), r"is not one number for each of the four wheels"),
    ],
)
def test_the_fields_of_the_encoders_are_asked_for_by_those_that_are_there(
    recording: Path, fields: tuple[str, ...], words: str
) -> None:
    with pytest.raises(CsvError, match=rf"topic /motor/encoder at log time.*{words}"):
        read_recording(recording, RoseOptions(track_width=TRACK, rate_fields=fields))


def test_clocks_that_have_no_time_in_common_are_told_and_log_times_help(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "raw", driven(), late=1e6)
    with pytest.raises(CsvError, match="have no time in common: give --stamps log"):
        read_recording(path, WITH_FIELDS)
    logged = RoseOptions(track_width=TRACK, rate_fields=("speeds",), stamps="log")
    assert len(read_recording(path, logged).poses.time) > 2300


def test_a_bag_of_something_else_is_refused(recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    (whole,) = (each for each in recording.iterdir() if each.suffix == ".mcap")
    path.write_bytes(whole.read_bytes()[:100])
    with pytest.raises((BagError, CsvError), match=r"cut\.mcap"):
        read_recording(path, WITH_FIELDS)
    sample = Path(__file__).parents[3] / "bags" / "sample"
    with pytest.raises((BagError, CsvError), match="no topic /optitrack/pose and /motor/encoder"):
        read_recording(sample, WITH_FIELDS)


def test_an_imu_that_is_asked_for_but_not_recorded_is_named(recording: Path) -> None:
    asked = RoseOptions(
        track_width=TRACK, rate_fields=("speeds",), acceleration_axis="x", acceleration_sd=0.1
    )
    with pytest.raises(CsvError, match="no topic /imu/data; it has /motor/encoder, /optitrack"):
        read_recording(recording, asked)


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        ({"position": 1e7}, "topic /optitrack/pose at log time .* cannot be: record again"),
        ({"quaternion": 0.3}, "pose.orientation .* has length 0.6 instead of 1"),
        ({"rate": 1e9}, "topic /motor/encoder at log time .* cannot be: record again"),
    ],
)
def test_a_message_that_cannot_be_is_named_with_its_time(
    tmp_path: Path, spoilt: dict[str, float], words: str
) -> None:
    drive = driven()
    changed = {name: np.full_like(getattr(drive, name), value) for name, value in spoilt.items()}
    path = write_recording(tmp_path / "raw", drive.changed(**changed))
    with pytest.raises(CsvError, match=words):
        read_recording(path, WITH_FIELDS)


def test_messages_out_of_order_or_twice_are_sorted_and_told(tmp_path: Path) -> None:
    drive = driven()
    time = drive.pose_time.copy()
    time[1000], time[1001] = time[1001], time[1000]
    time[1500] = time[1501]
    path = write_recording(tmp_path / "raw", drive.changed(pose_time=time))
    trial = read_recording(path, WITH_FIELDS)
    assert (np.diff(trial.poses.time) > 0.0).all()
    assert trial.notes == ("1 messages have the stamp of another one and are left out",)
