# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sets of sensors are refused by what they tell in a reference drive, not by their number."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rover_parameters.records import ConfigError
from terrain_estimator.cli import fleet, replay
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig, EstimatorConfig
from terrain_estimator.estimator.sensor_information import LARGEST_BOUND, bounds_of, doubt_of
from terrain_estimator.learning.reference_drives import measured_drives
from terrain_estimator.messaging.diagnostics import Level, judge_information
from terrain_estimator.model.metadata import ModelFileError, model_path, read_metadata
from terrain_estimator.offline.reference_drives import judge_sensors, reference_drives, write_drives

SOILS = ("loose_sand", "compact_sand", "regolith")
LEAST = CoreConfig(use_torque=False, use_moments=False, use_imu=False)
"""Velocity and load alone."""
NOISY = ConversionConfig(default_velocity_sd=5.0, default_pitch_sd=1.0)


@pytest.mark.parametrize("name", ["mars_rover", "paper_rover"])
@pytest.mark.parametrize("core", [CoreConfig(), CoreConfig(use_sinkage=False), LEAST])
def test_what_ships_tells_tan_phi_on_every_soil_with_few_sensors_too(
    name: str, core: CoreConfig
) -> None:
    config = EstimatorConfig(model=name, core=core)
    found, doubt = judge_sensors(load(name, "auto").model, config)
    assert tuple(found.bounds) == SOILS
    assert 0.0 < found.largest <= LARGEST_BOUND
    assert doubt == ""


def test_the_same_rows_with_too_much_noise_are_refused_by_name_and_number() -> None:
    model = load("paper_rover", "auto").model
    config = EstimatorConfig(model="paper_rover", core=LEAST, conversion=NOISY)
    with pytest.raises(ConfigError) as refused:
        judge_sensors(model, config)
    said = str(refused.value)
    assert all(f"on {soil}" in said for soil in SOILS)
    for part in ("use_torque: false", "default_sd.velocity: 5", "0.8 of the prior's deviation"):
        assert part in said
    drives = reference_drives(model_path("paper_rover"), model.metadata)
    assert min(bounds_of(model, config, drives).bounds.values()) > LARGEST_BOUND


def test_sensors_that_are_poor_on_some_soils_alone_are_a_warning() -> None:
    model = load("mars_rover", "auto").model
    drives = reference_drives(model_path("mars_rover"), model.metadata)
    standing = [
        dataclasses.replace(
            each,
            velocity_sd=9.0,
            pitch_sd=3.0,
            torque=math.nan * each.torque,
            bogie_angle=math.nan,
            acceleration=math.nan,
            wheel_rate=0.0 * each.wheel_rate,
        )
        for each in drives["regolith"]
    ]
    found = bounds_of(model, EstimatorConfig(), dict(drives) | {"regolith": standing})
    assert found.poor == ["regolith"]
    doubt = doubt_of(found, EstimatorConfig())
    assert "on some soils" in doubt
    assert "on regolith" in doubt
    finding = judge_information(found.largest, found.bounds, doubt)
    assert (finding.level, finding.text) == (Level.WARN, doubt)
    assert [key for key, _ in finding.details] == [f"bound {soil}" for soil in SOILS]


def test_the_drives_that_ship_are_made_again() -> None:
    """Their numbers have single precision."""
    metadata = read_metadata(model_path("mars_rover").with_suffix(".json"))
    ships, made = reference_drives(model_path(""), metadata), measured_drives(metadata)
    assert list(ships) == list(made) == list(SOILS)
    for soil in SOILS:
        for name in ("slip", "torque", "velocity", "acceleration_sd"):
            one, other = ([getattr(each, name) for each in drive[soil]] for drive in (ships, made))
            np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)


def test_who_says_what_tan_phi_is_may_have_poor_sensors() -> None:
    """A prior of c, or the soil's name, says nothing of tan phi."""
    model = load("paper_rover", "auto").model
    for knows, refused in (
        (dataclasses.replace(LEAST, prior_tan_phi_mean=0.6, prior_tan_phi_sd=0.05), False),
        (dataclasses.replace(LEAST, prior_cohesion_mean_pa=5e2, prior_cohesion_sd_pa=1e2), True),
    ):
        config = EstimatorConfig(model="paper_rover", core=knows, conversion=NOISY)
        if refused:
            with pytest.raises(ConfigError, match=r"say what the ground is by prior\.tan_phi_mean"):
                judge_sensors(model, config)
        else:
            found, doubt = judge_sensors(model, config)
            assert found.poor == list(SOILS)
            assert "these sensors leave the ground to your prior.tan_phi_mean" in doubt


def test_site_knowledge_is_no_sensor() -> None:
    core = dataclasses.replace(LEAST, prior_tan_phi_mean=0.6, prior_tan_phi_sd=0.01)
    config = EstimatorConfig(core=dataclasses.replace(core, prior_soil="regolith"))
    found, _ = judge_sensors(load("", "auto").model, config)
    assert list(found.bounds) == ["regolith"]


def test_a_rover_without_a_drive_is_not_judged_and_a_damaged_file_is_named(tmp_path: Path) -> None:
    path = model_path("mars_rover")
    metadata = read_metadata(path.with_suffix(".json"))
    other = dataclasses.replace(metadata, rover=dataclasses.replace(metadata.rover, mass=5.0))
    assert reference_drives(path, other) == {}
    (tmp_path / "mars_rover.drive.npz").write_bytes(b"PK damaged")
    with pytest.raises(ModelFileError, match=r"mars_rover\.drive\.npz: .*install"):
        reference_drives(tmp_path / "mine.pt", metadata)
    drives = reference_drives(path, metadata)
    one = metadata.soils[0]
    write_drives(tmp_path / "mars_rover.drive.npz", metadata, {one.name: drives[one.name]})
    again = reference_drives(tmp_path / "mine.pt", metadata)
    assert list(again) == [one.name]
    assert [each.velocity for each in again[one.name]] == [
        each.velocity for each in drives[one.name]
    ]


@pytest.mark.parametrize("command", [replay.main, lambda given: fleet.main(["replay", *given])])
def test_a_replay_refuses_them_before_it_reads_a_bag(
    command: Callable[[list[str]], int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--out", str(tmp_path / "out"), "-p", "standstill_speed:=1.0"]
    assert command([str(tmp_path), *given]) == replay.WRONG
    assert "is infinite on loose_sand" in (said := capsys.readouterr().err)
    assert "standstill_speed: 1" in said
