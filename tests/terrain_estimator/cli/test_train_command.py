# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``train`` to its end at its smallest size: the same file to the byte, from this process or from a cluster by its address."""

import json
from functools import partial
from pathlib import Path

import pytest
from distributed import LocalCluster

from terrain_estimator.cli import train
from terrain_estimator.learning.generation import Order
from terrain_estimator.learning.restore import restore
from terrain_estimator.model_file import load_model

SMALL = ["--rover", "mars_rover", "--soil", "loose_sand", "--tasks", "20", "--iterations", "3", "--columns", "2", "--hidden", "4"]


def call(folder: Path, *more: str) -> int:
    return train.main([*SMALL, "--constants-sd", "0", "--out", str(folder), "--curves", str(folder), *more])


def test_two_trainings_give_one_file_that_says_how_it_came_about(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(train, "Order", partial(Order, duration_s=5.0))
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        assert call(tmp_path / "cluster", "--scheduler", cluster.scheduler_address) == 0, capsys.readouterr().err
    assert call(tmp_path / "alone") == 0
    first, second = (tmp_path / folder / "mars_rover-loose_sand.pt" for folder in ("cluster", "alone"))
    assert first.read_bytes() == second.read_bytes()
    assert first.with_suffix(".json").read_bytes() == second.with_suffix(".json").read_bytes()
    assert first.with_suffix(".png").stat().st_size > 1000
    training = json.loads(first.with_suffix(".json").read_text())["training"]
    assert {"--tasks=20", "--constants-sd=0.0", "--strength=benchmark", "--device=cpu", "--hidden-effects=0.4"} < set(training["options"])
    assert train.recipe_of(train._parser().parse_args(training["options"])).hidden == 4
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
    assert restore(loaded).uncertain.shape[1] == 0


def test_an_impossible_deviation_of_the_constants_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert train.main([*SMALL, "--constants-sd", "nan", "--out", str(tmp_path)]) == 2
    assert "--constants-sd nan: give 0 to 0.2" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
