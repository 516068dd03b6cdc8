# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The example of the README: an effect is hidden, searched for by the command, and unsealed."""

import json
from pathlib import Path

import pytest

from tests.terrain_estimator.discovery.discover import main, new_folder


def test_a_hidden_drag_is_found_blind_and_unsealed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    asked = ["--seed", "7", "--hide", "drive_drag", "--seconds", "24", "--out", str(tmp_path)]
    assert main(asked) == 0
    told = capfd.readouterr().out
    assert "named: drive_drag" in told
    assert "Hidden was drive_drag" in told
    assert "The verdict is right." in told
    folder = tmp_path / "7"
    assert json.loads((folder / "truth.json").read_text())["hidden"]
    assert "Hidden was drive_drag" in (folder / "report.html").read_text()
    assert "Hidden was" not in (folder / "finding" / "report.html").read_text()


def test_no_folder_is_used_twice(tmp_path: Path) -> None:
    kept = tmp_path / "1" / "note.txt"
    first, second = new_folder(tmp_path / "1"), new_folder(tmp_path / "1")
    kept.write_text("mine", encoding="utf-8")
    assert (first.name, second.name, new_folder(tmp_path / "1").name) == ("1", "1_2", "1_3")
    assert kept.read_text(encoding="utf-8") == "mine"
