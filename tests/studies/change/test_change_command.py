# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``make change`` on two drives: detected at once, and an ended run continues."""

import json
from pathlib import Path

import numpy as np
import pytest

from studies.change import __main__ as command
from studies.change import drives as change
from terrain_estimator.learning.tasks import SOILS


def call(folder: Path, *more: str) -> int:
    place = [
        "--out",
        str(folder / "change.json"),
        "--table",
        str(folder / "change.md"),
        "--records",
        str(folder),
    ]
    return command.main(
        [
            "--rover",
            "mars_rover",
            "--jobs",
            "1",
            "--seed",
            "3",
            "--drives",
            "2",
            "--hours",
            "0.005",
            *place,
            *more,
        ]
    )


def test_two_sharp_changes_are_detected_and_an_ended_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two drives onto compact sand are detected within 3 s, where 90 % take less than 1 s.

    There is one short drive without a change, too.
    """
    monkeypatch.setattr(command, "KINDS", command.KINDS[:1])
    monkeypatch.setattr(command, "SOILS", SOILS[:1])
    monkeypatch.setattr(change, "_BEFORE_S", 10.0)
    monkeypatch.setattr(change, "_CONSTANT_S", 20.0)
    assert call(tmp_path, "--minutes", "1e-9") == 1
    assert "goes on where it was" in capsys.readouterr().err
    assert call(tmp_path) == 0
    run = json.loads((tmp_path / "change.json").read_text())
    (score,), (constant,) = run["changes"], run["constant"]
    assert score["drives"] == [2, 2, 2]
    assert score["detected"] == 1.0
    assert score["delay_p90_s"]["value"] <= 3.0
    assert score["crossing_s"] > 3.0
    assert np.isfinite(score["error_15_s"]).all()
    assert score["before"]["hours"] * 3600.0 > 10.0
    assert constant["hours"] == pytest.approx(20.0 / 3600.0)
    text = (tmp_path / "change.md").read_text()
    for words in (
        "loose to compact",
        "detected, median, mars_rover",
        "false alarms an hour, mars_rover",
        "2 / 2 / 2",
    ):
        assert words in text
    kept, lost = sorted(tmp_path.rglob("*.npz"), key=lambda path: "compact" not in path.name)
    before = kept.stat().st_mtime_ns
    lost.unlink()
    assert call(tmp_path) == 0
    assert kept.stat().st_mtime_ns == before
    assert json.loads((tmp_path / "change.json").read_text()) == run
