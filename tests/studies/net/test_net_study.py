# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of the net, at its smallest size."""

import json
from pathlib import Path

import pytest

from studies.net.__main__ import main


def test_a_small_study_compares_physics_with_and_without_the_net(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "net.json"
    assert (
        main(
            [
                "--episodes",
                "3",
                "--plant",
                "other effects",
                "--trust",
                "0.003",
                "0.5",
                "--out",
                str(out),
            ]
        )
        == 0
    )
    (plant,) = json.loads(out.read_text())["plants"]
    assert set(plant["with_net"]) == {"net, trusted 0.003", "net, trusted 0.5"}
    assert "NaN" not in out.read_text()
    for candidate in plant["with_net"].values():
        change, score = candidate["nll_change"], candidate["score"]
        assert change["low"] < change["value"] < change["high"]
        assert plant["physics"]["episodes"] == score["episodes"] == 3
        assert "coverage_95" in score["cohesion"]
        assert "bound" not in score["cohesion"]
    assert (
        plant["physics"]["nis"] > 1.5
    )  # the physics alone is wrong by more than the sensors' noise
    printed = capsys.readouterr().out
    assert "| other effects | physics |" in printed
    assert "| | net, trusted 0.5 |" in printed


def test_a_trust_that_is_no_probability_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--trust", "1.5"])
    assert "1.5 is no probability" in capsys.readouterr().err


def test_a_model_that_is_not_there_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--model", str(tmp_path / "none.pt")]) == 2
    assert "none.pt" in capsys.readouterr().err
