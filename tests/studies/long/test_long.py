# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of ``make long``, from drives with known errors, and a short run of the command."""

import json
from pathlib import Path

import pytest
import torch

from studies.accuracy.cells import CellBatch, Setting
from studies.accuracy.scores import Judged
from studies.long import __main__ as command
from studies.long.table import lines, page

DRIVES = 100
TIMES_S = (40.0, 400.0)


def judged(errors: torch.Tensor) -> Judged:
    """Return drives whose errors are ``errors`` [N, K] published deviations, those of the bound."""
    sd = torch.tensor([100.0, 0.01], dtype=torch.float64)
    truth = torch.tensor([[2000.0, 0.5]], dtype=torch.float64).expand(DRIVES, 2)
    times = errors.shape[1]
    return Judged(
        truth,
        truth.unsqueeze(1) + errors.unsqueeze(-1) * sd,
        torch.diag(sd**2).expand(DRIVES, times, 2, 2),
        sd.expand(DRIVES, times, 2),
        sd.expand(DRIVES, 2),
        torch.zeros(DRIVES),
        torch.zeros(DRIVES, 4),
        torch.zeros(DRIVES, 5),
        torch.zeros(DRIVES),
    )


def test_coverage_and_shift_are_judged_after_each_time() -> None:
    """Of 100 errors 10 are two deviations at first; later all are one deviation to one side."""
    early = torch.zeros(DRIVES, dtype=torch.float64)
    early[:5], early[5:10] = 2.0, -2.0
    errors = torch.stack([early, torch.ones(DRIVES, dtype=torch.float64)], 1)
    setting = Setting("paper_rover", "loose_sand", rows=("v+L",), times_s=TIMES_S)
    parts = [CellBatch({("v+L", "physics"): judged(errors)}, [], [])] * 2
    first, second = lines(setting, parts)
    assert (first.after_s, first.drives) == (40.0, 2 * DRIVES)
    assert first.cohesion.covered.value == pytest.approx(0.9)
    assert first.cohesion.shift.value == pytest.approx(0.0)
    assert second.tan_phi.covered.value == 1.0
    assert second.tan_phi.shift.value == pytest.approx(1.0)
    assert second.cohesion.of_bound == pytest.approx(1.0 / 0.67449, rel=1e-4)
    assert second.cohesion.median_error == pytest.approx(0.05)
    text = page([first, second], "Measured.", 7)
    assert "| paper | exact | v+L | 40 | 200 |" in text
    assert text.count("c shift, tan phi shift |") == 1


def test_the_command_writes_a_page_and_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two drives of each kind that last 7 or 8 s instead of minutes and an hour."""
    monkeypatch.setattr(command, "BATCH", 2)
    monkeypatch.setattr(command, "MINUTES_S", (6.0, 7.0))
    monkeypatch.setattr(command, "HOUR_S", (6.0, 8.0))
    out, table = tmp_path / "long.json", tmp_path / "long.md"
    call = ["--jobs", "1", "--minutes-of-driving", "1", "--hours", "1", "--seed", "3"]
    call += ["--records", str(tmp_path), "--out", str(out), "--table", str(table)]
    assert command.main(call) == 0
    cells = json.loads(out.read_text())["cells"]
    assert {(cell["rows"], cell["after_s"]) for cell in cells} == {
        *((rows, after) for rows in ("v+L", "v+L+M", "v+L+M+B") for after in (6.0, 7.0)),
        *((rows, after) for rows in ("v+L", "v+L+M+B") for after in (6.0, 8.0)),
    }
    assert {cell["drives"] for cell in cells} == {2}
    lost, *kept = sorted(tmp_path.rglob("*.npz"))
    before = [path.stat().st_mtime_ns for path in kept]
    lost.unlink()
    assert command.main(call) == 0
    assert [path.stat().st_mtime_ns for path in kept] == before
    again = json.loads(out.read_text())["cells"]  # sums of floats may round otherwise
    for name in ("cohesion", "tan_phi"):
        errors = [[cell[name]["median_error"] for cell in every] for every in (again, cells)]
        assert errors[0] == pytest.approx(errors[1], rel=1e-6)
