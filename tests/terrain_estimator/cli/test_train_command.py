# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``train`` at its smallest size gives the same bytes from this process and from a cluster."""

import dataclasses
import json
import os
import re
import subprocess
import sys
import zipfile
from functools import partial
from pathlib import Path

import pytest
from distributed import LocalCluster

from rover_parameters.records import ConfigError
from terrain_estimator.cli import train
from terrain_estimator.learning.generation import Order
from terrain_estimator.learning.restore import restore
from terrain_estimator.model.metadata import MODELS, ModelFileError, model_names
from terrain_estimator.model.model_file import load_model
from terramechanics.presets import load_rover, load_soil

SMALL = [
    "--rover",
    "mars_rover",
    "--soil",
    "loose_sand",
    "--tasks",
    "20",
    "--iterations",
    "3",
    "--columns",
    "2",
    "--hidden",
    "4",
]


@pytest.mark.parametrize("name", model_names())
def test_a_model_that_ships_holds_its_options_and_no_folder(name: str) -> None:
    training = load_model(name).metadata.training
    own = ["--columns", "6"] if name.endswith("_with_net") else []
    own += ["--ground-variation", "0.02"] if name.endswith("_on_varying_ground") else []
    given, wanted = (train._parser().parse_args(each) for each in (training.options, own))
    assert train.recipe_of(given) == train.recipe_of(wanted)
    assert given.constants_sd == wanted.constants_sd
    assert given.ground_variation == wanted.ground_variation
    with zipfile.ZipFile(MODELS / f"{name}.pt") as archive:
        assert not [each for each in archive.namelist() if each.endswith("debug_pkl")]


def test_two_processes_give_one_file(tmp_path: Path) -> None:
    """Python draws the order of a set of names anew in every process."""
    contents = []
    for seed in ("1", "2"):
        folder = tmp_path / seed
        command = [sys.executable, "-m", train.__name__, *SMALL, "--out", str(folder)]
        subprocess.run(
            [*command, "--curves", str(folder)],
            env=os.environ | {"PYTHONHASHSEED": seed},
            check=True,
            capture_output=True,
        )
        contents.append((folder / "mars_rover-loose_sand_with_net.pt").read_bytes())
    assert contents[0] == contents[1]


def call(folder: Path, *more: str) -> int:
    return train.main(
        [*SMALL, "--constants-sd", "0", "--out", str(folder), "--curves", str(folder), *more]
    )


def test_two_trainings_give_one_file_that_says_how_it_came_about(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(train, "Order", partial(Order, duration_s=5.0))
    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        assert call(tmp_path / "cluster", "--scheduler", cluster.scheduler_address) == 0, (
            capsys.readouterr().err
        )
    assert call(tmp_path / "alone") == 0
    first, second = (
        tmp_path / folder / "mars_rover-loose_sand_with_net.pt" for folder in ("cluster", "alone")
    )
    assert first.read_bytes() == second.read_bytes()
    assert first.with_suffix(".json").read_bytes() == second.with_suffix(".json").read_bytes()
    assert first.with_suffix(".png").stat().st_size > 1000
    training = json.loads(first.with_suffix(".json").read_text())["training"]
    assert {
        "--tasks=20",
        "--constants-sd=0.0",
        "--strength=benchmark",
        "--device=cpu",
        "--hidden-effects=0.4",
    } < set(training["options"])
    assert train.recipe_of(train._parser().parse_args(training["options"])).hidden == 4
    with zipfile.ZipFile(first) as archive:
        contents = b"".join(archive.read(name) for name in archive.namelist())
    assert str(MODELS.parent).encode() not in contents, "folders of this machine"
    loaded = load_model(str(first))
    assert loaded.metadata.parameters == (
        "cohesion_kpa",
        "tan_phi",
        "net_0",
        "net_1",
        "mass",
        "centre_of_mass",
        "acceleration_bias",
        "velocity",
    )
    assert restore(loaded).layout.constants == 0
    monkeypatch.setattr(train, "check_export", refuse)
    kept = {path.name: path.read_bytes() for path in (tmp_path / "alone").iterdir()}
    assert call(tmp_path / "alone", "--seed", "5") == 2
    assert "differs from the trained model" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in (tmp_path / "alone").iterdir()} == kept


@pytest.mark.parametrize(("end", "variation"), [("", "0.0"), ("_on_varying_ground", "0.02")])
def test_the_models_that_ship_without_a_net_are_made_again_to_the_byte(
    tmp_path: Path, end: str, variation: str
) -> None:
    """In a process of its own: what it has scripted before changes names in a file."""
    command = [sys.executable, "-m", train.__name__, "--ground-variation", variation]
    command += ["--out", str(tmp_path), "--curves", str(tmp_path)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert "loss" not in done.stdout
    for name in (f"mars_rover{end}", f"paper_rover{end}"):
        for ending in (".pt", ".json"):
            made, ships = (folder / f"{name}{ending}" for folder in (tmp_path, MODELS))
            assert made.read_bytes() == ships.read_bytes()
        metadata = load_model(name).metadata
        assert not any(each.startswith("net_") for each in metadata.parameters)
        assert metadata.training.options == (
            "--columns=0",
            f"--constants-sd={0.05 / 3**0.5}",
            f"--ground-variation={variation}",
        )
        assert not (tmp_path / f"{name}.png").exists()


@pytest.mark.parametrize(
    ("option", "value"),
    [("--tasks", "2000"), ("--scheduler", "tcp://host:8786"), ("--hidden-effects", "0.0")],
)
def test_an_option_of_the_training_is_refused_where_nothing_is_trained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    assert train.main([option, value, "--out", str(tmp_path / "models")]) == 2
    said = capsys.readouterr().err
    assert re.search(rf"{option} \S+: without --columns nothing is trained: give --columns 6", said)
    assert not (tmp_path / "models").exists()


def test_a_model_of_the_velocity_alone_says_so_in_its_name_and_its_description(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ["--rover", "mars_rover", "--soil", "loose_sand", "--rows", "velocity"]
    assert train.main([*own, "--constants-sd", "0", "--out", str(tmp_path)]) == 0
    assert not capsys.readouterr().err
    path = tmp_path / "mars_rover-loose_sand_velocity_alone.pt"
    loaded = load_model(str(path))
    assert loaded.used_rows == ("velocity",)
    assert loaded.metadata.training.options == (
        "--columns=0",
        "--constants-sd=0.0",
        "--ground-variation=0.0",
        "--rows=velocity",
    )
    assert path.with_suffix(".drive.npz").is_file()
    assert train.main([*own, "--out", str(tmp_path)]) == 0
    assert "the velocity alone does not tell soil constants" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value"),
    [("--columns", "6"), ("--ground-variation", "0.02"), ("--soil", "loose_sand compact_sand")],
)
def test_what_the_velocity_alone_does_not_go_with_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    own = ["--soil", "loose_sand", "--rows", "velocity", option, *value.split()]
    assert train.main([*own, "--out", str(tmp_path / "models")]) == 2
    assert f"{option} {value} with --rows velocity: " in capsys.readouterr().err
    assert not (tmp_path / "models").exists()


def test_installed_models_are_not_replaced(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(train, "draw", None)
    assert not train._parser().parse_args([]).out.resolve().is_relative_to(MODELS)
    before = {path.name: path.stat().st_mtime_ns for path in MODELS.iterdir()}
    assert train.main([*SMALL, "--out", str(MODELS)]) == 2
    assert f"{MODELS}: holds " in capsys.readouterr().err
    assert {path.name: path.stat().st_mtime_ns for path in MODELS.iterdir()} == before


def refuse(*_: object) -> None:
    raise ModelFileError("differs from the trained model")


def test_an_impossible_deviation_of_the_constants_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train.main([*SMALL, "--constants-sd", "nan", "--out", str(tmp_path)]) == 2
    assert "--constants-sd nan: give 0 to 0.2" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "wrong",
    [
        ("--seed", "-1"),
        ("--tasks", "19"),
        ("--iterations", "0"),
        ("--columns", "-1"),
        ("--hidden", "0"),
        ("--workers", "-1"),
        ("--hidden-effects", "2"),
        ("--caution", "0"),
        ("--caution", "nan"),
        ("--orthogonality-strength", "nan"),
    ],
)
def test_a_number_that_cannot_be_trained_with_is_refused_by_its_option(
    capsys: pytest.CaptureFixture[str], wrong: tuple[str, str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        train.main([*SMALL, *wrong])
    assert ended.value.code == 2
    assert f"argument {wrong[0]}: {wrong[1]}: give " in capsys.readouterr().err


def test_names_that_would_be_one_file_and_a_folder_that_is_none_are_refused_before_any_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(train, "draw", None)
    rover, soil = load_rover("mars_rover"), load_soil("loose_sand")
    for rovers, soils, said in (
        (
            [rover, dataclasses.replace(rover, mass=190.0)],
            [soil],
            "two rovers are called mars_rover-loose_sand",
        ),
        ([rover], [soil, soil], "two soils are called loose_sand"),
        ([dataclasses.replace(rover, name="../mine")], [soil], "without slashes"),
    ):
        with pytest.raises(ConfigError, match=said):
            train.file_names(rovers, soils)
    occupied = tmp_path / "occupied"
    occupied.touch()
    for option in ("--out", "--curves"):
        assert call(tmp_path / "models", option, str(occupied)) == 2
        assert f"{occupied}: is a file, not a folder" in capsys.readouterr().err
    assert (
        train.main([*SMALL, "--rover", "mars_rover", "no_rover", "--out", str(tmp_path / "models")])
        == 2
    )
    assert "no_rover: neither one of the rovers" in capsys.readouterr().err
