# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Single-wheel tables of a laboratory; they are no part of the repository."""

import json
import math
from pathlib import Path

import pytest

from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.discovery.single_wheel.cells import cells_of
from terrain_estimator.discovery.single_wheel.table import WheelTableError, read_table

MEASURED = Path(__file__).parents[4] / "shared" / "data" / "single_wheel"
pytestmark = pytest.mark.skipif(
    not MEASURED.is_dir(), reason="the measured tables are not here (../shared)"
)


def test_measured_tables_are_read_and_replicates_are_one_setting() -> None:
    rows, left_out = read_table(MEASURED / "smooth_wheel.csv", "larger")
    assert all("does not turn" in reason for reason in left_out)
    assert {round(math.degrees(row.slip_angle)) for row in rows} == {0, 15, 45}
    assert all(row.lateral_force > 0.0 for row in rows if row.slip_angle)
    cells = cells_of(rows)
    assert set(cells.replicates) == {2}
    assert len(rows) == 2 * len(cells.slip)
    with pytest.raises(WheelTableError, match="no column"):
        read_table(MEASURED / "README.md", "larger")


def test_what_grousers_change_is_not_claimed_to_be_certain_and_repeats_closer_than_the_smooth_model(
    tmp_path: Path,
) -> None:
    soil, wheel, out = (tmp_path / name for name in ("soil.yaml", "wheel.yaml", "out"))
    constants = {
        "n": 1.46,
        "k_c": 0.0,
        "k_phi": 8.0e6,
        "shear_modulus": 0.01,
        "c1": 0.3,
        "c2": 0.2,
        "cohesion": 300.0,
        "tan_phi": 0.554,
    }
    soil.write_text(json.dumps({"name": "dry_sand"} | constants), encoding="utf-8")
    wheel.write_text("name: testbed\nradius: 0.058\nwidth: 0.05\n", encoding="utf-8")
    tables = [
        "--wheel-table",
        str(MEASURED / "grouser_wheel.csv"),
        "--reference",
        str(MEASURED / "smooth_wheel.csv"),
    ]
    asked = [
        "--slip-definition",
        "larger",
        "--largest-slip-angle",
        "0",
        "--hold-out-by",
        "trial",
        "--library",
        "slip_sinkage,rate_dependence,grousers",
    ]
    assert (
        main([*tables, "--wheel", str(wheel), "--soil", str(soil), *asked, "--out", str(out)]) == 0
    )
    finding = json.loads((out / "finding.json").read_text(encoding="utf-8"))
    assert finding["verdict"] != "named"
    assert finding["gap"]["proven"] is None
    assert finding["parameters"]["after"] is None
    for row in ("sinkage", "drawbar_pull"):
        assert finding["gap"]["rows"][row]["after"] < finding["gap"]["rows"][row]["before"], row
