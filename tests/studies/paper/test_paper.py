# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The whole program at its smallest size."""

import json
from pathlib import Path

import pytest

from studies.paper.__main__ import main
from studies.paper.published import TRADE_OFF
from studies.paper.random_inputs import STRENGTHS


def test_a_quick_run_writes_every_table_and_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--quick", "--jobs", "2", "--out", str(tmp_path)]) == 0
    written = {Path(line).name for line in capsys.readouterr().out.splitlines()}
    assert written == {path.name for path in tmp_path.iterdir()}
    assert {
        "closed_form.json",
        "integrated.json",
        "run.json",
        "tables.md",
        "trade_off_integrated.png",
        "random_inputs.md",
    } <= written
    table = (tmp_path / "random_inputs.md").read_text()
    assert "compact sand, 2 seeds" in table
    assert table.count("P-ALPaCA + nominal, 0.033 |") == 2
    content = json.loads((tmp_path / "random_inputs.json").read_text())
    assert [(each["soil"], each["seed"]) for each in content["seeds"]] == [
        ("loose_sand", 0),
        ("loose_sand", 1),
        ("compact_sand", 0),
        ("compact_sand", 1),
    ]
    for plant in ("closed_form", "integrated"):
        cell = json.loads((tmp_path / f"{plant}.json").read_text())["loose_sand"]
        assert set(TRADE_OFF) <= set(cell["testing"])
        for scores in cell["testing"].values():
            assert "velocity_rms_mm_s" in scores or "cohesion_error_percent" in scores
        low, middle, high = cell["testing"]["linear"]["cohesion_error_percent"]["5"]
        assert 0.0 < low <= middle <= high
        assert "cohesion_error_percent" in cell["exact_constants"]["Cramer-Rao bound"]


def test_only_the_training_on_random_inputs_leaves_the_rest_out(tmp_path: Path) -> None:
    assert main(["--quick", "--only", "random_inputs", "--out", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"random_inputs.json", "random_inputs.md"}
    measured, *rows = (tmp_path / "random_inputs.md").read_text().splitlines()
    assert '`make paper ARGS="--only random_inputs"`' in measured
    assert sum("trained on the band" in row for row in rows) == 2 * len(STRENGTHS), "two soils"


def test_an_output_folder_that_cannot_be_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["--quick", "--out", str(tmp_path / "file")]) == 2
    assert "file" in capsys.readouterr().err
