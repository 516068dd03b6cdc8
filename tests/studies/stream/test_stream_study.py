# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``make stream`` on few drives: predictions and intervals are calibrated."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from studies.stream import __main__ as stream_study
from studies.stream.drives import Streamed
from studies.stream.table import score
from terrain_estimator.learning.tasks import ROVERS

DRIVES = 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("stream_study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stream_study, "BATCH", DRIVES)
        assert call(place) == 0
    return place


def call(folder: Path, *more: str) -> int:
    place = [
        "--out",
        str(folder / "figures.json"),
        "--table",
        str(folder / "page.md"),
        "--records",
        str(folder / "records"),
    ]
    return stream_study.main(
        ["--batches", "1", "--jobs", "1", "--soil", "loose_sand", *place, *more]
    )


def test_forecasts_are_in_their_intervals_as_often_as_these_say(folder: Path) -> None:
    """8 drives of 350 predictions: outside 93 to 97 % in 1 of 1000, if independent and of 95 %."""
    cells: list[dict[str, Any]] = json.loads((folder / "figures.json").read_text())["cells"]
    assert [cell["rover"] for cell in cells] == [rover for rover in ROVERS for _ in range(2)]
    count = sum(cell["settled"]["count"] for cell in cells)
    assert count > 8 * 340
    assert binom.cdf(0.93 * count, count, 0.95) + binom.sf(0.97 * count, count, 0.95) < 1e-3
    assert (
        0.93
        < sum(cell["settled"]["inside_95"] * cell["settled"]["count"] for cell in cells) / count
        < 0.97
    )
    for cell in cells:
        assert cell["drives"] == DRIVES
        assert 0.85 < cell["settled"]["calibration"] < 1.2, cell["rover"]
        assert 0.8 < cell["early"]["inside_95"] < 1.0, cell["rover"]


def test_the_page_names_model_and_drives_and_what_is_kept_is_not_computed_again(
    folder: Path,
) -> None:
    page = (folder / "page.md").read_text()
    for text in (
        f"{DRIVES} drives of 40 s",
        "paper_rover-",
        "mars_rover-",
        "| mars | loose | 5 % | 2 |",
        f"| all |  |  | {4 * DRIVES} |",
    ):
        assert text in page
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*.npz")}
    assert len(before) == 4
    assert call(folder) == 0
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.npz")} == before
    assert (folder / "page.md").read_text() == page


def test_each_drive_counts_once_when_its_soil_is_first_neither_sure_nor_unlikely() -> None:
    nothing = np.zeros((3, 2))
    probability = np.array([[0.5, 0.9, 0.99], [0.93, 0.6, 0.86], [0.5, 0.84, 0.96]])
    right = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    count = np.ones(3)
    streamed = Streamed(
        nothing + 1.0, nothing + 1.0, nothing + 1.0, nothing, nothing,
        np.ones((3, 100)), np.ones((3, 100)), probability, right, count, count,
    )  # fmt: skip
    found = score("mars_rover", "mars_rover-1", "loose_sand", 0.0, streamed).soil_found
    assert (found.drives, found.right) == (2, 1)
    assert found.probability == pytest.approx(0.5 * (0.9 + 0.93))


def test_no_time_for_one_batch_of_each_cell_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(folder, "--seed", "1", "--minutes", "1e-9") == 1
    assert "goes on where it was" in capsys.readouterr().err
