# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of what the net is worth, at its smallest size."""

import json
from pathlib import Path

import pytest

from terrain_estimator.cli.net_study import main


def test_a_small_study_compares_physics_with_and_without_the_net(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "net.json"
    assert main(["--episodes", "3", "--plant", "other effects", "--out", str(out)]) == 0
    (plant,) = json.loads(out.read_text())["plants"]
    change = plant["nll_change"]
    assert change["low"] < change["mean"] < change["high"]
    assert plant["physics"]["episodes"] == plant["with_net"]["episodes"] == 3
    assert "NaN" not in out.read_text()
    assert "coverage_95" in plant["with_net"]["cohesion"]
    assert "bound" not in plant["with_net"]["cohesion"]
    assert plant["physics"]["nis"] > 1.5  # the physics alone is wrong by more than the sensors' noise
    assert "| other effects | physics |" in capsys.readouterr().out


def test_a_model_that_is_not_there_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--model", str(tmp_path / "none.pt")]) == 2
    assert "none.pt" in capsys.readouterr().err
