# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Models that a user makes have reference drives beside them, by which their sensors are judged."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from rover_parameters.records import ConfigError
from rover_sim_node.twist_commands import SHARPEST
from terrain_estimator.cli import add_effect, export_core, model_by_wheel, replay, train
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig, EstimatorConfig
from terrain_estimator.estimator.sensor_information import LARGEST_BOUND, bounds_of
from terrain_estimator.learning.reference_drives import measured_drives
from terrain_estimator.messaging.diagnostics import NOT_CHECKED, Level, judge_information
from terrain_estimator.model.metadata import ModelFileError, read_metadata
from terrain_estimator.observation import Floats
from terrain_estimator.offline.reference_drives import ENDING, judge_sensors, reference_drives
from tests.rovers import FOUR_WHEELS

SOILS = ["loose_sand", "compact_sand"]
ROVER = ["--rover", FOUR_WHEELS.name, "--soil", *SOILS]
LEAST = CoreConfig(use_torque=False, use_moments=False, use_imu=False)
"""Velocity and load alone."""
NOISY = ConversionConfig(default_velocity_sd=5.0, default_pitch_sd=1.0)
NOISY_BY_WHEEL = dataclasses.replace(
    NOISY, default_lateral_velocity_sd=5.0, default_yaw_rate_sd=5.0, torque_absolute_sd=1e4
)
MODELS = {
    FOUR_WHEELS.name: (LEAST, NOISY, "use_torque: false"),
    f"{FOUR_WHEELS.name}_by_wheel": (
        dataclasses.replace(LEAST, use_torque=True),
        NOISY_BY_WHEEL,
        "torque_noise.absolute: 10000",
    ),
}
"""By the names of their files, with sensors that tell too little, and words about the torques."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of two models of a rover that does not ship, by axle and by wheel."""
    folder = tmp_path_factory.mktemp("models")
    assert train.main([*ROVER, "--out", str(folder), "--curves", str(folder)]) == 0
    skid = [*ROVER, "--track-width", "0.57", "--out", str(folder)]
    assert model_by_wheel.main(skid) == 0
    return folder


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("core", [CoreConfig(), CoreConfig(use_sinkage=False), None])
def test_sensors_that_tell_start_without_a_warning(
    made: Path, name: str, core: CoreConfig | None
) -> None:
    path = str(made / f"{name}.pt")
    core = core or MODELS[name][0]
    config = EstimatorConfig(model=path, core=core)
    found, doubt = judge_sensors(load(path, "auto").model, config)
    assert list(found.bounds) == SOILS
    assert 0.0 < found.largest <= LARGEST_BOUND
    assert doubt == ""


@pytest.mark.parametrize("name", MODELS)
def test_sensors_that_tell_nothing_are_refused_by_name(made: Path, name: str) -> None:
    path = made / f"{name}.pt"
    model = load(str(path), "auto").model
    core, noise, words = MODELS[name]
    config = EstimatorConfig(model=str(path), core=core, conversion=noise)
    with pytest.raises(ConfigError) as refused:
        judge_sensors(model, config)
    for part in (words, "default_sd.velocity: 5", *(f"on {soil}" for soil in SOILS)):
        assert part in str(refused.value)
    assert ("default_sd.yaw_rate: 5" in str(refused.value)) == bool(model.metadata.wheels)
    drives = reference_drives(path, model.metadata)
    read = dataclasses.replace(noise, torque_absolute_sd=0.0)
    torques = dataclasses.replace(config, core=CoreConfig(), conversion=read)
    assert bounds_of(model, torques, drives).poor == []


@pytest.mark.parametrize("name", MODELS)
def test_a_replay_refuses_them_too(
    made: Path, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--model", str(made / f"{name}.pt"), "--out", str(tmp_path / "out")]
    slow = ["-p", "standstill_speed:=1.0"]
    assert replay.main([str(tmp_path / "none"), *given, *slow]) == replay.WRONG
    assert "is infinite on loose_sand, infinite on compact_sand" in capsys.readouterr().err


def test_a_drive_by_wheel_has_straight_stretches_and_bends_to_both_sides(made: Path) -> None:
    path = made / f"{FOUR_WHEELS.name}_by_wheel.pt"
    drives = reference_drives(path, read_metadata(path.with_suffix(".json")))
    for soil in SOILS:
        turns = np.array([each.yaw_rate for each in drives[soil]])
        assert len(turns) == 400
        assert turns.max() > 0.1
        assert turns.min() < -0.1
        assert (abs(turns) < 0.01).sum() > 100
        assert not np.array([each.steering for each in drives[soil]]).any(), "a skid-steer"
        assert all(each.slip.shape == (4,) for each in drives[soil])


def test_with_ackermann_steering_the_front_wheels_turn_in_and_the_rear_ones_roll(
    made: Path,
) -> None:
    metadata = read_metadata(made / f"{FOUR_WHEELS.name}_by_wheel.json")
    assert metadata.wheel_places is not None
    front = dataclasses.replace(metadata.wheel_places, steered=("front_left", "front_right"))
    (drive,) = measured_drives(
        dataclasses.replace(metadata, soils=metadata.soils[:1], wheel_places=front), 6.0
    ).values()
    sharpest = max(drive, key=lambda each: each.yaw_rate)
    assert sharpest.steering is not None
    left, right, *rear = sharpest.steering.tolist()
    assert SHARPEST > left > right > 0.1  # [rad] the inner wheel turns in further
    assert rear == [0.0, 0.0]


def test_a_soil_on_which_the_rover_gets_stuck_has_no_drive(made: Path) -> None:
    for name in MODELS:
        metadata = read_metadata(made / f"{name}.json")
        heavy = dataclasses.replace(metadata.rover, mass=800.0)
        drives = measured_drives(dataclasses.replace(metadata, rover=heavy), 3.0)
        assert list(drives) == ["compact_sand"]


@pytest.mark.parametrize("name", MODELS)
def test_a_rover_that_no_simulation_takes_over_the_hills_has_no_drive(
    made: Path, name: str
) -> None:
    metadata = read_metadata(made / f"{name}.json")
    giant = dataclasses.replace(metadata.rover, wheel_radius=60.0, axle_x=(90.0, -90.0))
    assert measured_drives(dataclasses.replace(metadata, rover=giant), 3.0) == {}


@pytest.mark.parametrize("name", MODELS)
def test_a_rover_with_two_wheels_a_side_of_each_axle_has_a_drive(made: Path, name: str) -> None:
    metadata = read_metadata(made / f"{name}.json")
    wheels = tuple(
        dataclasses.replace(each, name=f"{each.name}_{twin}")
        for each in metadata.rover.wheels
        for twin in (1, 2)
    )
    twins = dataclasses.replace(metadata, rover=dataclasses.replace(metadata.rover, wheels=wheels))
    (drive,) = measured_drives(dataclasses.replace(twins, soils=metadata.soils[:1]), 1.0).values()
    assert all(each.slip.shape == (8 if metadata.wheels else 2,) for each in drive)


def test_an_unknown_gain_of_the_torques_is_judged(tmp_path: Path) -> None:
    given = ["--rover", FOUR_WHEELS.name, "--soil", "loose_sand", "--track-width", "0.57"]
    assert model_by_wheel.main([*given, "--torque-gain-sd", "0.1", "--out", str(tmp_path)]) == 0
    path = str(tmp_path / f"{FOUR_WHEELS.name}_by_wheel.pt")
    found, doubt = judge_sensors(load(path, "auto").model, EstimatorConfig(model=path))
    assert (list(found.bounds), doubt) == (["loose_sand"], "")


def test_training_again_replaces_what_it_wrote_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--rover", FOUR_WHEELS.name, "--out", str(tmp_path), "--curves", str(tmp_path)]
    assert train.main([*given, "--soil", "loose_sand"]) == 0
    assert train.main([*given, "--soil", "compact_sand"]) == 0
    drives = [tmp_path / f"{FOUR_WHEELS.name}-{soil}{ENDING}" for soil in SOILS]
    before = drives[0].read_bytes()
    assert train.main([*given, "--soil", "loose_sand"]) == 0
    assert drives[0].read_bytes() == before, "the same drives again"
    assert drives[1].is_file(), "a model of another soil keeps its own"
    drives[0].write_bytes(b"mine")
    capsys.readouterr()
    assert train.main([*given, "--soil", "loose_sand"]) == 2
    assert f"{drives[0]}: has changed since it was written" in capsys.readouterr().err
    assert drives[0].read_bytes() == b"mine"


def test_a_model_without_drives_is_not_checked_and_diagnostics_say_so(
    made: Path, tmp_path: Path
) -> None:
    for ending in (".pt", ".json"):
        shutil.copyfile(made / f"{FOUR_WHEELS.name}{ending}", tmp_path / f"copy{ending}")
    path = str(tmp_path / "copy.pt")
    config = EstimatorConfig(model=path, core=LEAST, conversion=NOISY)
    found, doubt = judge_sensors(load(path, "auto").model, config)
    assert (found.bounds, doubt) == ({}, "")
    finding = judge_information(found.largest, found.bounds, doubt)
    assert (finding.level, finding.text) == (Level.OK, NOT_CHECKED)
    assert "sensors not checked" in finding.text
    shutil.copyfile(made / f"{FOUR_WHEELS.name}{ENDING}", tmp_path / f"copy{ENDING}")
    with pytest.raises(ConfigError, match="leave the ground to the prior"):
        judge_sensors(load(path, "auto").model, config)


@pytest.mark.parametrize(
    ("array", "values", "said"),
    [
        ("loose_sand/slip", np.zeros((400, 3)), r"loose_sand/slip has the shape \(400, 3\), not"),
        ("loose_sand/velocity", np.zeros(2), r"loose_sand/velocity has the shape"),
        ("more", np.zeros(9 << 20), "holds more than 64 MiB"),
    ],
)
def test_a_file_of_drives_that_cannot_be_is_named(
    made: Path, tmp_path: Path, array: str, values: Floats, said: str
) -> None:
    with np.load(made / f"{FOUR_WHEELS.name}{ENDING}") as archive:
        arrays = {name: archive[name] for name in archive.files}
    np.savez_compressed(tmp_path / "copy.drive.npz", **(arrays | {array: values}))
    metadata = read_metadata(made / f"{FOUR_WHEELS.name}.json")
    with pytest.raises(ModelFileError, match=rf"copy\.drive\.npz: {said}.*make the model anew"):
        reference_drives(tmp_path / "copy.pt", metadata)


@pytest.mark.parametrize("name", MODELS)
def test_a_model_with_an_added_effect_has_the_drives_of_the_first(
    made: Path, name: str, tmp_path: Path
) -> None:
    path = tmp_path / "dragged.pt"
    given = ["--effect", "coulomb_drag", "--model", str(made / f"{name}.pt"), "--out", str(path)]
    assert add_effect.main(given) == 0
    assert (
        path.with_name(f"dragged{ENDING}").read_bytes() == (made / f"{name}{ENDING}").read_bytes()
    )
    found, doubt = judge_sensors(load(str(path), "auto").model, EstimatorConfig(model=str(path)))
    assert (list(found.bounds), doubt) == (SOILS, "")


def test_a_build_of_the_core_writes_the_drives_that_are_missing_alone(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export_core, "build_core", lambda *_: None)  # takes minutes
    monkeypatch.setattr(export_core, "write_core", lambda _, folder: folder.mkdir())
    for ending in (".pt", ".json"):
        shutil.copyfile(made / f"{FOUR_WHEELS.name}{ending}", tmp_path / f"mine{ending}")
    model, drives = tmp_path / "mine.pt", tmp_path / f"mine{ENDING}"
    assert export_core.main([str(model), str(tmp_path / "core"), "--build"]) == 0
    assert drives.read_bytes() == (made / f"{FOUR_WHEELS.name}{ENDING}").read_bytes()
    first = drives.stat().st_mtime_ns
    assert export_core.main([str(model), str(tmp_path / "again"), "--build"]) == 0
    assert drives.stat().st_mtime_ns == first
