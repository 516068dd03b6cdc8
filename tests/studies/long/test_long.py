# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of ``make long``, from drives with known errors, and a short run of the command."""

import json
from pathlib import Path

import numpy as np
import pytest

from studies.long import __main__ as command
from studies.long.table import lines, page
from tests.studies.streamed_drives import streamed

DRIVES = 200
TIMES_S = (40.0, 400.0)


def test_coverage_and_shift_are_judged_after_each_time() -> None:
    """Of 200 errors 20 are two deviations at first; later all are one deviation to one side."""
    errors = np.zeros((DRIVES, 2))
    errors[:10, 0], errors[10:20, 0], errors[:, 1] = 2.0, -2.0, 1.0
    drives = streamed(errors)
    drives.least[:] = np.nan
    first, second = lines("paper_rover", 0.0, TIMES_S, {"v+L": drives})
    assert (first.after_s, first.drives) == (40.0, DRIVES)
    assert first.cohesion.inside_95.value == pytest.approx(0.9)
    assert first.cohesion.shift.value == pytest.approx(0.0)
    assert second.tan_phi.inside_95.value == 1.0
    assert second.tan_phi.shift.value == pytest.approx(1.0)
    assert second.cohesion.median_error == pytest.approx(0.05)
    written = page([first, second], "Measured.", 7).splitlines()
    assert "| paper | exact | v+L | 400 | 200 | 100 / 100 | +1.00 / +1.00 |" in "".join(written)
    assert next(row for row in written if row.startswith("| paper")).endswith("| 400 s |")
    rows = written[written.index("## paper_rover") :]
    assert any(row.startswith("| exact | v+L | 40 | 200 | 0.0 |  | 90.0 (") for row in rows)
    assert rows[-2].endswith("|  |")
    assert rows[-1].endswith("| c shift, tan phi shift |")


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
        *((rows, after) for rows in ("v+L", "v+L+M", "all") for after in (6.0, 7.0)),
        *((rows, after) for rows in ("v+L", "all") for after in (6.0, 8.0)),
    }
    assert {cell["drives"] for cell in cells} == {2}
    bounds = {cell["after_s"]: cell["cohesion"]["of_bound"]["value"] for cell in cells}
    assert bounds[7.0] > 0.0
    assert np.isnan(bounds[8.0])
    lost, *kept = sorted(tmp_path.rglob("*.npz"))
    before = [path.stat().st_mtime_ns for path in kept]
    lost.unlink()
    assert command.main(call) == 0
    assert [path.stat().st_mtime_ns for path in kept] == before
    again = json.loads(out.read_text())["cells"]  # sums of floats may round otherwise
    for name in ("cohesion", "tan_phi"):
        errors = [[cell[name]["median_error"] for cell in every] for every in (again, cells)]
        assert errors[0] == pytest.approx(errors[1], rel=1e-6)
