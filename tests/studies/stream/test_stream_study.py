# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``make stream`` on few drives: predictions and intervals are calibrated."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from studies.stream import __main__ as stream_study
from studies.stream.drives import Streamed
from studies.stream.scores import strength_score
from studies.stream.table import score
from studies.stream.targets import TARGETS, worst_of
from terrain_estimator.learning.tasks import ROVERS
from tests.studies.streamed_drives import streamed

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
        *(f"| mars | loose | 5 % | 2 | {rows} |" for rows in ("v+L", "v+L+M", "all")),
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
    at_end = nothing[:, np.newaxis]
    streamed = Streamed(
        nothing + 1.0, at_end + 1.0, at_end + 1.0, at_end, at_end, count, at_end + 1.0,
        np.ones((3, 100)), np.ones((3, 100)), probability, right, count, count,
    )  # fmt: skip
    found = score("mars_rover", "mars_rover-1", "loose_sand", 0.0, {"all": streamed}).soil_found
    assert (found.drives, found.right) == (2, 1)
    assert found.probability == pytest.approx(0.5 * (0.9 + 0.93))


def test_no_time_for_one_batch_of_each_cell_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(folder, "--seed", "1", "--minutes", "1e-9") == 1
    assert "goes on where it was" in capsys.readouterr().err


def streamed_with(errors: NDArray[np.float64]) -> Streamed:
    """Return drives whose last errors are ``errors`` [N] deviations, those before nine.

    The first half is identified, the first tenth never published.
    """
    drives = streamed(np.stack([np.full_like(errors, 9.0), errors], 1))
    drives.identified[len(errors) // 2 :] = 0.0
    drives.published[: len(errors) // 10] = 0.0
    return drives


def test_a_parameter_is_scored_at_the_time_that_is_asked_for() -> None:
    errors = np.tile([-0.5, 0.5, 1.5, -2.5, 0.5], 40)
    found = strength_score(streamed_with(errors), 1, 0)
    assert found.median_error == pytest.approx(0.025)
    assert found.of_bound.value == pytest.approx(0.5 / 0.67449, rel=1e-4)
    assert found.inside_95.value == pytest.approx(0.8)
    assert found.inside_68 is not None
    assert found.inside_68.value == pytest.approx(0.6)  # of 180 that published
    assert found.shift.value == pytest.approx(-0.1)
    assert (found.known, found.identified) == (200, 0.5)
    assert found.identified_of_known is not None
    assert found.identified_of_known.value == 0.5
    assert strength_score(streamed_with(errors), 0, 0).shift.value == pytest.approx(9.0)


def test_a_drive_that_the_bound_cannot_identify_is_not_asked_to_be() -> None:
    drives = streamed_with(np.zeros(10))
    drives.least[:, 1, 0] = 0.4 * 1300.0  # 0.16 of the prior's variance
    found = strength_score(drives, 1, 0)
    assert (found.known, found.identified_of_known) == (0, None)


def test_a_target_names_its_worst_cell_and_counts_those_whose_limits_exclude_it() -> None:
    good = strength_score(streamed_with(np.tile([-0.5, 0.5], 100)), 1, 0)
    bad = strength_score(streamed_with(np.tile([-2.5, 2.0], 100)), 1, 0)
    covered = worst_of(TARGETS[0], [("good", good), ("bad", bad)])
    assert covered is not None
    assert (covered.cell, covered.missed, covered.cells) == ("bad", 2, 2)  # 100 % is too much, too
    shift = worst_of(TARGETS[2], [("good", good), ("bad", bad)])
    assert shift is not None
    assert (shift.cell, shift.missed) == ("bad", 0)
    identified = worst_of(TARGETS[3], [("good", good)])
    assert identified is not None
    assert identified.missed == 1
    assert worst_of(TARGETS[3], []) is None
