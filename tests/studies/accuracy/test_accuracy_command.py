# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``make accuracy`` on few episodes: its figures are those of a calibrated, efficient estimator."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from scipy.stats import binom

from studies.accuracy import __main__ as accuracy
from studies.accuracy import cells as study
from studies.accuracy.cells import seed_of, settings
from studies.accuracy.scores import PAPER_BAND, ROWS, draw_drives, row_mask, share_of
from terramechanics.presets import load_rover, load_soil
from tests.samples import sampled

EPISODES, BATCHES = sampled((20, 1), (40, 2))
CHOICE = ["--jobs", "1", "--rover", "mars_rover", "--soil", "regolith", "--constants", "exact"]


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Batches that share the episodes; the grid has a few episodes, whose command has twenty."""
    folder = tmp_path_factory.mktemp("accuracy")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "REFERENCE_EPISODES", sampled(2, 4))
        patch.setattr(accuracy, "BATCH", EPISODES // BATCHES)
        for batches in range(1, BATCHES + 1):
            assert call(folder, EPISODES * batches // BATCHES) == 0
        yield folder


def call(folder: Path, episodes: int, *more: str) -> int:
    place = [
        "--out",
        str(folder / "accuracy.json"),
        "--table",
        str(folder / "accuracy.md"),
        "--records",
        str(folder),
    ]
    return accuracy.main(["--episodes", str(episodes), *CHOICE, *place, *more])


@pytest.fixture(scope="module")
def figures(records: Path) -> dict[str, Any]:
    page = (records / "accuracy.md").read_text()
    for title in (
        "Targets",
        "over hills",
        "grid reference",
        "net",
        f"{EPISODES} of the {EPISODES} drives",
    ):
        assert title in page
    result: dict[str, Any] = json.loads((records / "accuracy.json").read_text())
    return result


def test_a_batch_that_is_kept_is_not_computed_again(
    records: Path, figures: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.stat().st_mtime_ns for path in records.rglob("*.npz")}
    assert len(before) == BATCHES
    assert call(records, EPISODES) == 0
    assert {path: path.stat().st_mtime_ns for path in records.rglob("*.npz")} == before
    assert json.loads((records / "accuracy.json").read_text())["cells"] == figures["cells"]
    assert call(records, EPISODES, "--seed", "1", "--minutes", "1e-9") == 1
    assert "not one batch" in capsys.readouterr().err


def test_a_damaged_record_is_named(
    records: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = Path(shutil.copytree(records, tmp_path / "copy"))
    record = next(copy.rglob("*.npz"))
    record.write_bytes(record.read_bytes()[:5000])
    assert call(copy, EPISODES) == 2
    assert record.name in capsys.readouterr().err


def test_every_row_set_is_judged_and_more_rows_tell_more(figures: dict[str, Any]) -> None:
    cells = {cell["rows"]: cell["score"] for cell in figures["cells"]}
    assert set(cells) == set(ROWS)
    bounds = [cells[rows]["tan_phi"]["bound"][-1] for rows in ROWS]
    assert bounds == sorted(set(bounds), reverse=True)
    for score in cells.values():
        assert score["cohesion"]["bound"] == sorted(score["cohesion"]["bound"], reverse=True)


def test_intervals_cover_the_truth_and_errors_are_near_the_bound(figures: dict[str, Any]) -> None:
    """Judge all episodes: so few covered have a probability below 1 % at a coverage of 95 %.

    So has a ratio beyond 0.6 or 1.6.
    """
    least = binom.ppf(0.01, EPISODES, 0.95)
    for cell in figures["cells"]:
        for name in ("cohesion", "tan_phi"):
            parameter = cell["score"][name]
            assert parameter["coverage_95"]["value"] * EPISODES >= least, (cell["rows"], name)
            assert (
                parameter["coverage_95"]["low"]
                < parameter["coverage_95"]["value"]
                <= parameter["coverage_95"]["high"]
            )
            assert 0.6 < parameter["ratio_to_bound"][-1] < 1.6, (cell["rows"], name)
            assert parameter["narrowest"] > 0.5, (cell["rows"], name)


def test_the_ellipse_of_both_parameters_covers_the_truth(figures: dict[str, Any]) -> None:
    """Judge all episodes: so few in the ellipse have a probability below 0.1 % at 95 %."""
    least = binom.ppf(1e-3, EPISODES, 0.95)
    for cell in figures["cells"]:
        assert cell["score"]["joint_coverage_95"]["value"] * EPISODES >= least, cell["rows"]


def test_innovations_and_misfits_are_consistent(figures: dict[str, Any]) -> None:
    """Every episode has 350 predictions and 40 blocks."""
    for cell in figures["cells"]:
        assert 0.93 < cell["score"]["velocity_coverage_95"] < 0.97, cell["rows"]
        assert 0.95 < cell["score"]["velocity_calibration"] < 1.05, cell["rows"]
        assert 0.9 < cell["score"]["nis"] < 1.1, cell["rows"]


def test_the_recursion_is_near_the_grid_reference(figures: dict[str, Any]) -> None:
    (check,) = figures["reference"]
    assert max(check["median_shift"]) < 0.1
    assert check["largest_edge"] < 1e-3


def test_the_settings_are_all_cells_with_seeds_of_their_own() -> None:
    every = settings()
    assert len([setting for setting in every if set(setting.rows) == set(ROWS)]) == 12
    assert {setting.schedule for setting in every} == {"S1", "S2", "S3", "S4"}
    assert any(setting.truth == "paper" for setting in every)
    assert len({seed_of(setting, 0, batch) for setting in every for batch in range(2)}) == 2 * len(
        every
    )


def test_the_papers_band_holds_the_truth_and_a_stuck_episode_ends_before_it_struggles() -> None:
    rover, soil = load_rover("mars_rover"), load_soil("compact_sand")
    drives = draw_drives(rover, soil, "S1", 30, 0.0, 3, PAPER_BAND)
    assert ((drives.tasks.strength[:, 0] >= 700.0) & (drives.tasks.strength[:, 0] <= 1300.0)).all()
    stuck = drives.ends < 400
    assert stuck.any()
    for episode in torch.nonzero(stuck).squeeze(1).tolist():
        assert (
            drives.tasks.usable[episode, : max(int(drives.ends[episode]) - 1, 0)].double().mean()
            > 0.9
            or drives.ends[episode] < 20
        )


def test_the_limits_of_a_share_are_those_of_clopper_and_pearson() -> None:
    share = share_of(torch.arange(100) < 95)
    assert share.value == pytest.approx(0.95)
    assert binom.sf(94, 100, share.low) == pytest.approx(0.005, rel=1e-6)
    assert binom.cdf(95, 100, share.high) == pytest.approx(0.005, rel=1e-6)


def test_a_row_set_without_torque_masks_all_torques() -> None:
    assert row_mask("v+L", 3).tolist() == [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def test_a_choice_without_settings_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert accuracy.main(["--soil", "regolith", "--schedule", "S2"]) == 2
    assert "S2" in capsys.readouterr().err
