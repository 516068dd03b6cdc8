# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""model_by_wheel writes a model that loads, and refuses what does not fit the rover."""

import re
from pathlib import Path

import pytest

from rover_parameters.records import ConfigError
from terrain_estimator.cli.model_by_wheel import main
from terrain_estimator.compiled.source import recorded_drive
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packed_observation import packed_size
from terramechanics.presets import PRESETS
from terramechanics.vehicle.wheel_places import box_inertia

SKID = ["--rover", "four_wheel_rover", "--soil", "loose_sand", "compact_sand"]
ACKERMANN = ["front_left", "front_right"]


def test_it_writes_a_model_with_the_given_places_and_the_same_bytes_each_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--track-width", "0.57", "--steered", *ACKERMANN, "--out", str(tmp_path)]
    assert main([*SKID, *options]) == 0
    path = tmp_path / "four_wheel_rover_by_wheel.pt"
    assert capsys.readouterr().out.endswith(f"-p model:={path}\n")
    model = load_model(str(path))
    places = model.metadata.wheel_places
    assert places is not None
    assert (places.track_width, places.steered) == (0.57, tuple(ACKERMANN))
    assert places.yaw_inertia == box_inertia(model.rover, 0.57)
    assert model.metadata.steered == (True, True, False, False)
    assert [soil.name for soil in model.metadata.soils] == ["loose_sand", "compact_sand"]
    assert recorded_drive(model.metadata).shape[1] == packed_size(4, by_wheel=True)
    assert "centre_of_mass_y" in model.metadata.parameters
    assert model.balances_sinkage
    again = ["--track-width", "0.57", "--steered", *ACKERMANN, "--out", str(tmp_path / "again")]
    assert main([*SKID, *again]) == 0
    assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()


def test_a_model_for_ground_that_varies_has_a_name_of_its_own(tmp_path: Path) -> None:
    options = ["--track-width", "0.57", "--ground-variation", "0.02", "--out", str(tmp_path)]
    assert main([*SKID, *options]) == 0
    model = load_model(str(tmp_path / "four_wheel_rover_by_wheel_on_varying_ground.pt"))
    assert model.metadata.prior.ground_variation == 0.02
    with pytest.raises(SystemExit):
        main([*SKID, "--track-width", "0.57", "--ground-variation", "0.5"])


def test_a_gain_and_friction_of_the_torques_become_parameters(tmp_path: Path) -> None:
    rover = ["--rover", "four_wheel_rover", "--soil", "loose_sand", "--track-width", "0.57"]
    options = [*rover, "--torque-gain-sd", "0.1", "--out", str(tmp_path)]
    for more, names in (((), ["torque_gain"]), (("0.2",), ["torque_gain", "torque_friction"])):
        friction = [word for each in more for word in ("--torque-friction-sd", each)]
        assert main([*options, *friction]) == 0
        model = load_model(str(tmp_path / "four_wheel_rover_by_wheel.pt"))
        first = model.metadata.parameters.index("roll_bias") + 1
        assert list(model.metadata.parameters[first : first + len(names)]) == names
        assert "torque_friction" not in model.metadata.parameters[first + len(names) :]
        with pytest.raises(ConfigError, match=r"use_sinkage.*a torque gain that is not known"):
            Estimator(model, CoreConfig(use_sinkage=False))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--track-width", "0.57", "--steered", "middle_left"], "steered: middle_left"),
        (["--track-width", "0.1"], "track_width 0.1 m has no room"),
        (["--track-width", "0.57", "--rover", "cube"], "cube"),
        (["--track-width", "0.57", "--torque-friction-sd", "1"], "needs --torque-gain-sd"),
        (["--track-width", "0.57", "--soil", "SCM"], "knows law wong_reece alone, not scm"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_name_and_nothing_is_written(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soil = tmp_path / "scm.yaml"
    loose = (PRESETS / "soils/loose_sand.yaml").read_text()
    soil.write_text(re.sub(r"(?m)^c2: .*$", "c2: 0.0", loose) + "law: scm\n")
    given = [str(soil) if each == "SCM" else each for each in options]
    assert main([*SKID, *given, "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not list((tmp_path / "out").glob("*.pt"))
