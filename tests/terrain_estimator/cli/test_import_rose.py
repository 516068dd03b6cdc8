# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Trials in RoSE Lab's schema become bags whose velocity and slip are right within their noise."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from terrain_estimator.bags import BagReader
from terrain_estimator.cli import model_by_wheel, replay
from terrain_estimator.cli.import_rose import main
from terrain_estimator.messaging.conversion import nose_up_pitch
from terrain_estimator.topics import LATERAL_IN_TWIST, stamp_ns
from terramechanics.presets import load_soil
from tests.terrain_estimator.importing.rose_trial import (
    GAIN,
    HEADER,
    POSITION_SD,
    ROVER,
    SLOPE,
    START,
    TRACK,
    driven,
    rows,
    write_recording,
    write_table,
)
from tests.terrain_estimator.kinds import exported

TURN = (8.0, 12.0)  # [s]
RECORDING = ["--rate-fields", "speeds", "--current-fields", "load_a,load_b,load_c,load_d"]


def convert(trial: Path, *arguments: str) -> int:
    """Convert a trial to the bag beside it."""
    track = [] if "--straight-only" in arguments else ["--track-width", str(TRACK)]
    return main([str(trial), "--out", str(trial.parent / "bag"), *track, *arguments])


def messages(folder: Path, topic: str) -> list[Any]:
    with BagReader(folder) as reader:
        return [reader.decode(message) for message in reader.messages([topic])]


def table(folder: Path, **changed: Any) -> Path:
    return write_table(folder / "Processed_Data.csv", rows(driven().changed(**changed)))


@pytest.fixture(scope="module", params=["csv", "mcap"])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp(request.param)
    currents = ["--torque-gain", str(GAIN), "--torque-sd", "0.1"]
    if request.param == "csv":
        assert convert(table(folder), *currents) == 0
    else:
        assert convert(write_recording(folder / "raw", driven()), *RECORDING, *currents) == 0
    return folder / "bag"


def truth(stamps: list[int]) -> list[int]:
    """Return the sample of the simulator that holds at each stamp."""
    return [math.floor((stamp / 1e9 - START) / 0.1 + 1e-6) - 1 for stamp in stamps]


def scatter(errors: np.ndarray[Any, Any]) -> None:
    """Assert that errors in deviations are those of independent noise of the stated size."""
    count = errors.size
    assert count > 150
    assert abs(errors.mean()) < 4.0 / math.sqrt(count)
    assert abs((errors**2).mean() - 1.0) < 5.0 * math.sqrt(2.0 / count)
    assert abs((errors[1:] * errors[:-1]).mean()) < 4.0 / math.sqrt(count)


def test_velocity_is_that_of_the_rover_within_the_stated_noise(bag: Path) -> None:
    found, drive = messages(bag, "/odom"), driven()
    at = truth([stamp_ns(each) for each in found])
    assert len(found) > 190
    assert at == list(range(len(at)))
    speeds = np.array([each.twist.twist.linear.x for each in found])
    sds = np.sqrt([each.twist.covariance[0] for each in found])
    scatter((speeds - drive.velocity[at, 0]) / sds)
    # twelve poses in a tenth of a second, every second one: 0.2 mm / sqrt(SUM t^2)
    assert np.median(sds) == pytest.approx(POSITION_SD / math.sqrt(6 * 35 / 12 / 60**2), rel=0.1)


def test_slip_of_every_wheel_is_right_in_turns_too_and_independent_of_the_velocity(
    bag: Path,
) -> None:
    found, drive = messages(bag, "/wheel_slip"), driven()
    at = truth([stamp_ns(each) for each in found])
    assert list(found[0].wheel) == list(ROVER.wheel_names)
    slips, sds = (
        np.array([getattr(each, name) for each in found]) for name in ("slip", "slip_stddev")
    )
    # the deviation of a wheel is for the mean of an axle: see messaging/slip_source.py
    errors = (slips - drive.slip[at]) / sds * math.sqrt(2.0)
    errors = errors[np.isfinite(errors).all(1)]
    turns = (drive.time[at] > TURN[0] + 0.5) & (drive.time[at] < TURN[1])
    assert np.ptp(drive.slip[at][turns], axis=1).min() > 0.3  # left and right differ
    for wheel in range(4):
        # deviations hold the radius, too, which is exact here
        assert 0.3 < (errors[:, wheel] ** 2).mean() < 1.2
        assert abs(errors[:, wheel].mean()) < 4.0 / math.sqrt(len(errors))
    odom = messages(bag, "/odom")
    speeds = np.array([each.twist.twist.linear.x for each in odom])
    missed = (speeds - drive.velocity[at, 0])[-len(errors) :]
    assert abs(np.corrcoef(missed, errors[:, 0])[0, 1]) < 4.0 / math.sqrt(len(errors))


def test_pitch_wheel_rate_and_torque_arrive_and_what_is_not_measured_is_not_invented(
    bag: Path,
) -> None:
    drive = driven()
    joints, imu, sinkage = (
        messages(bag, f"/{name}") for name in ("joint_states", "imu", "wheel_sinkage")
    )
    at = truth([stamp_ns(each) for each in joints])
    straight = drive.time[at] < TURN[0]
    pitches = np.array([nose_up_pitch(each.orientation) for each in imu])
    assert pitches[straight] == pytest.approx(math.atan(SLOPE), abs=2e-3)
    assert {each.orientation_covariance[4] for each in imu} == {math.radians(0.5) ** 2}
    assert {each.linear_acceleration_covariance[0] for each in imu} == {-1.0}
    order = slice(5, 60)  # away from the jump of the turn
    for name, expected, error in (("velocity", drive.rate, 0.02), ("effort", drive.torque, 0.05)):
        values = np.array([getattr(each, name) for each in joints])
        np.testing.assert_allclose(values[order], expected[at][order], atol=error, rtol=0.02)
    for name in ("sinkage", "sinkage_stddev", "contact_angle", "contact_angle_stddev"):
        assert np.isnan([getattr(each, name) for each in sinkage]).all()
    with BagReader(bag) as reader:
        record = reader.metadata["import_rose"]
    assert "CC BY 4.0" in record["source"]
    assert json.loads(record["options"])["track_width"] == TRACK


def test_replay_takes_the_bag_and_refuses_for_the_reason_that_was_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert convert(table(tmp_path)) == 0
    told = capsys.readouterr().out
    assert "not in the data: sinkage, contact_angle, torque, acceleration; wheel_sinkage" in told
    assert "refuses every observation (NOT_FINITE) and replay gives NO ESTIMATE" in told
    model = exported(ROVER, tmp_path)
    given = [str(tmp_path / "bag"), "--model", str(model), "--out", str(tmp_path / "out")]
    assert replay.main(given) == 3
    told = capsys.readouterr().out
    assert "NO ESTIMATE" in told
    assert "NOT_FINITE" in told


def test_torques_and_even_ground_make_an_estimate_without_sinkages(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated = ["--torque-gain", str(GAIN), "--torque-sd", "0.05", "--contact-angle-sd", "0.2"]
    assert convert(table(tmp_path), *stated) == 0
    told = capsys.readouterr().out
    assert "not in the data: sinkage, acceleration; wheel_sinkage holds NaN" in told
    assert "NO ESTIMATE" not in told
    sinkage = messages(tmp_path / "bag", "/wheel_sinkage")
    assert {tuple(each.contact_angle) for each in sinkage} == {(0.0,) * 4}
    sds = np.array([each.contact_angle_stddev for each in sinkage])
    assert sds == pytest.approx(math.radians(0.2))
    model, out = exported(ROVER, tmp_path), tmp_path / "out"
    given = [str(tmp_path / "bag"), "--model", str(model), "--out", str(out)]
    assert replay.main([*given, "-p", "torque_noise.relative:=0.05"]) == 0
    found = json.loads((out / "summary.json").read_text())["bags"][0]["estimate"]
    soil = load_soil("loose_sand")
    for name, true in (("cohesion_pa", soil.cohesion), ("tan_phi", soil.tan_phi)):
        assert abs(found[name]["mean"] - true) < 3.0 * found[name]["sd"]
    assert found["tan_phi"]["sd"] < 0.11  # half of the prior's


def test_the_lateral_velocity_is_that_of_the_rover_within_the_stated_noise(bag: Path) -> None:
    found, drive = messages(bag, "/odom"), driven()
    at = truth([stamp_ns(each) for each in found])
    lateral = np.array([each.twist.twist.linear.y for each in found])
    sds = np.sqrt([each.twist.covariance[LATERAL_IN_TWIST] for each in found])
    # heading and lateral velocity change within the window of a line
    steady = np.abs(np.gradient(drive.velocity[at, 2])) < 1e-3
    scatter(((lateral - drive.velocity[at, 1]) / sds)[steady])
    assert np.abs(drive.velocity[:, 1]).max() > 3.0 * np.median(sds)


def test_a_model_by_wheel_uses_the_turn_without_sinkages(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated = ["--torque-gain", str(GAIN), "--torque-sd", "0.05", "--contact-angle-sd", "0.2"]
    assert convert(table(tmp_path), *stated) == 0
    turning = ["--rover", ROVER.name, "--soil", "loose_sand", "--track-width", str(TRACK)]
    models, out = tmp_path / "models", tmp_path / "out"
    assert model_by_wheel.main([*turning, "--out", str(models)]) == 0
    model = models / f"{ROVER.name}_by_wheel.pt"
    given = [str(tmp_path / "bag"), "--model", str(model), "--out", str(out)]
    assert replay.main([*given, "-p", "torque_noise.relative:=0.05"]) == 0
    bag = json.loads((out / "summary.json").read_text())["bags"][0]
    assert "NOT_PLANAR" not in capsys.readouterr().out
    found, soil = bag["estimate"], load_soil("loose_sand")
    for name, true in (("cohesion_pa", soil.cohesion), ("tan_phi", soil.tan_phi)):
        assert abs(found[name]["mean"] - true) < 3.0 * found[name]["sd"]
    assert found["tan_phi"]["sd"] < 0.11  # half of the prior's


def test_turning_seconds_are_told_and_left_out_on_demand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = table(tmp_path)
    assert convert(trial) == 0
    whole = messages(tmp_path / "bag", "/odom")
    told = capsys.readouterr().out
    seconds = float(told.split("the rover turns for ")[1].split()[0])
    assert seconds == pytest.approx(TURN[1] - TURN[0], abs=0.6)
    assert "they are kept (--straight-only leaves them out)" in told
    arguments = [str(trial), "--straight-only", "--out", str(tmp_path / "straight")]
    assert main(arguments) == 0
    straight = messages(tmp_path / "straight", "/odom")
    assert len(whole) - len(straight) == round(10 * seconds)
    at = truth([stamp_ns(each) for each in straight])
    assert np.abs(driven().velocity[at, 2]).max() < 0.05
    assert main([*arguments[:-1], str(tmp_path / "all"), "--turn-rate", "9"]) == 0
    assert len(messages(tmp_path / "all", "/odom")) == len(whole)
    assert "turns for 0.0 of" in capsys.readouterr().out


def test_a_trial_without_the_track_is_refused_unless_turns_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(table(tmp_path)), "--out", str(tmp_path / "bag")]) == 2
    assert "give --track-width" in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()


def test_a_frozen_pose_a_gap_and_empty_cells_give_no_sample(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = rows(driven())
    when = np.array([line[0] - START for line in lines])
    for at in np.flatnonzero((when > 4.0) & (when < 5.0)):
        lines[at][1:8] = lines[at - 1][1:8]  # tracking is lost, and the last pose is repeated
    for at in np.flatnonzero((when > 6.0) & (when < 6.5)):
        lines[at][1] = math.nan
    kept = [line for line, time in zip(lines, when, strict=True) if not 14.0 < time < 16.0]
    kept.insert(100, kept[99])  # a row that is written twice
    assert convert(write_table(tmp_path / "data.csv", kept)) == 0
    told = capsys.readouterr().out
    stamps = np.array([stamp_ns(each) / 1e9 for each in messages(tmp_path / "bag", "/odom")])
    stamps -= START
    for low, high in ((4.05, 5.0), (6.05, 6.45), (14.05, 15.95)):
        assert not ((stamps > low) & (stamps < high)).any()
    assert ((stamps > 5.1) & (stamps < 5.95)).sum() >= 8
    assert "1 rows repeat the row before" in told
    held, lost = (float(told.split(f" {words}")[0].split()[-1]) for words in ("s repeat", "s lack"))
    assert held == pytest.approx(1.0, abs=0.25)
    assert lost == pytest.approx(2.5, abs=0.4)


def test_a_rover_that_stands_has_a_velocity_of_zero_and_no_slip(tmp_path: Path) -> None:
    lines = rows(driven())
    for line in lines[:240]:  # two seconds, with the pose rounded to one value
        line[1:8], line[22:26] = lines[240][1:8], [0.0] * 4
    assert convert(write_table(tmp_path / "data.csv", lines)) == 0
    slips, odom = (messages(tmp_path / "bag", topic)[:19] for topic in ("/wheel_slip", "/odom"))
    assert np.isnan([each.slip for each in slips]).all()
    velocities = [each.twist.twist.linear.x for each in odom]
    assert velocities == pytest.approx([0.0] * 19, abs=1e-15)  # rounding
    assert stamp_ns(odom[0]) / 1e9 < START + 0.2


def test_units_names_axes_signs_and_the_place_of_the_pose_can_be_stated(tmp_path: Path) -> None:
    plain = rows(driven())
    assert convert(write_table(tmp_path / "data.csv", plain), "--position-sd", "2e-4") == 0
    expected = messages(tmp_path / "bag", "/wheel_slip")
    pitches = [nose_up_pitch(each.orientation) for each in messages(tmp_path / "bag", "/imu")]
    header = ["seconds" if name == "time_s" else name for name in HEADER]
    changed = []
    for line in plain:
        x, y, z = line[1:4]
        a, b, c, d = line[4:8]
        # the world's up becomes y (x y z -> z x y), the pose's frame likewise; mm and deg/s
        moved = [line[0], 1e3 * y, 1e3 * z, 1e3 * x, b, c, a, d, *line[8:]]
        moved[22:26] = [math.degrees(value) * (-1) ** at for at, value in enumerate(line[22:26])]
        changed.append(moved)
    (tmp_path / "other").mkdir()
    other = write_table(tmp_path / "other" / "data.csv", changed, header)
    stated = ["--column", "time_s=seconds", "--position-unit", "mm", "--rate-unit", "deg/s"]
    stated += ["--body-axes", "z,y", "--world-up", "y", "--wheel-signs", "1,-1,1,-1"]
    assert convert(other, *stated, "--position-sd", "2e-4") == 0
    found = messages(tmp_path / "other" / "bag", "/wheel_slip")
    for name in ("slip", "slip_stddev"):
        np.testing.assert_allclose(
            [getattr(each, name) for each in found],
            [getattr(each, name) for each in expected],
            rtol=1e-6,
            atol=1e-9,
        )
    imu = messages(tmp_path / "other" / "bag", "/imu")
    np.testing.assert_allclose(
        [nose_up_pitch(each.orientation) for each in imu], pitches, atol=1e-9
    )


def test_a_pose_beside_the_middle_gives_the_velocity_of_the_middle(tmp_path: Path) -> None:
    drive, left = driven(), 0.2
    x, y, z, w = drive.quaternion.T
    across = np.stack([2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)], -1)
    trial = table(tmp_path, position=drive.position + left * across)
    assert convert(trial, "--pose-left", str(left)) == 0
    found = messages(tmp_path / "bag", "/odom")
    at = truth([stamp_ns(each) for each in found])
    sds = np.sqrt([each.twist.covariance[0] for each in found])
    scatter((np.array([each.twist.twist.linear.x for each in found]) - drive.velocity[at, 0]) / sds)


@pytest.mark.parametrize("window", ["0.3", "0.1"])
def test_a_longer_window_smooths_and_the_deviation_still_holds_in_the_mean(
    tmp_path: Path, window: str
) -> None:
    assert convert(table(tmp_path), "--window", window) == 0
    found = messages(tmp_path / "bag", "/odom")
    at = np.array(truth([stamp_ns(each) for each in found]))
    speeds = np.array([each.twist.twist.linear.x for each in found])
    sds = np.sqrt([each.twist.covariance[0] for each in found])
    calm = (at > 25) & (at < 75)  # before the turn
    missed = (speeds - driven().velocity[at, 0])[calm]
    # the mean of all has the deviation that independent samples would have
    assert abs(missed.mean()) < 4.0 * math.sqrt((sds[calm] ** 2).sum()) / calm.sum()
    wide = float(window) > 0.1
    assert np.median(sds) == pytest.approx(1e-3 if wide else 2.9e-3, rel=0.3)


def test_a_table_that_is_slow_is_taken_with_a_longer_line_and_a_too_slow_one_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = rows(driven())
    assert convert(write_table(tmp_path / "data.csv", lines[::12])) == 0  # 10 Hz
    assert "the poses of 0.6 s" in capsys.readouterr().out
    found = messages(tmp_path / "bag", "/odom")
    at = np.array(truth([stamp_ns(each) for each in found]))
    calm = (at > 25) & (at < 75)
    speeds = np.array([each.twist.twist.linear.x for each in found])
    assert np.abs(speeds - driven().velocity[at, 0])[calm].max() < 5e-3
    assert convert(write_table(tmp_path / "data.csv", lines[::60])) == 2  # 2 Hz
    assert "poses come so seldom" in capsys.readouterr().err


def test_the_acceleration_is_taken_along_the_stated_axis_alone(tmp_path: Path) -> None:
    given = ("--acceleration-axis=-x", "--acceleration-sd", "0.05")
    assert convert(table(tmp_path), *given) == 0
    imu = messages(tmp_path / "bag", "/imu")
    accelerations = np.array([each.linear_acceleration.x for each in imu])
    np.testing.assert_allclose(accelerations, -9.81 * SLOPE)
    variances = np.array([each.linear_acceleration_covariance[0] for each in imu])
    assert np.median(variances) == pytest.approx(0.05**2 / 12)


def test_an_option_of_the_other_format_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_messages = (
        ["--rate-fields", "speeds"],
        ["--current-fields", "a,b,c,d"],
        ["--stamps", "log"],
    )
    csv = table(tmp_path)
    for option in of_messages:
        assert convert(csv, *option) == 2
        assert option[0] in (said := capsys.readouterr().err)
        assert "is a CSV file, not a recording, so it changes nothing: leave it out" in said
    (tmp_path / "trial.mcap").touch()
    assert convert(tmp_path / "trial.mcap", "--column", "time_s=t") == 2
    assert "--column: " in (said := capsys.readouterr().err)
    assert "trial.mcap is a recording, not a CSV file, so it changes nothing" in said
    assert not (tmp_path / "bag").exists()


def test_an_existing_bag_stays_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "mine").write_text("mine")
    assert convert(table(tmp_path)) == 2
    assert "bag" in capsys.readouterr().err
    assert [each.name for each in (tmp_path / "bag").iterdir()] == ["mine"]
    assert (tmp_path / "bag" / "mine").read_text() == "mine"


def test_a_rover_of_six_wheels_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert convert(table(tmp_path), "--rover", "mars_rover") == 2
    assert "rover mars_rover: the dataset's rover has two axles" in capsys.readouterr().err
    content = ROVER.content() | {"name": "cube", "wheel_radius": 0.01}
    (tmp_path / "cube.yaml").write_text(yaml.safe_dump(json.loads(json.dumps(content))))
    assert convert(table(tmp_path), "--rover", str(tmp_path / "cube.yaml")) == 2
    assert "times as fast as the rims" in capsys.readouterr().err
