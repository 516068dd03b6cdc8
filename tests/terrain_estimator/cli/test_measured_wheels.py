# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Single-wheel tables of a laboratory without torque."""

import json
import math
from pathlib import Path

import pytest

from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.discovery.single_wheel.cells import cells_of
from terrain_estimator.discovery.single_wheel.table import WheelTableError, read_table

MEASURED = Path(__file__).parents[3] / "bags" / "measured"


def test_measured_tables_are_read_and_replicates_are_one_setting() -> None:
    rows, left_out = read_table(MEASURED / "cmu_smooth.csv", "larger")
    assert all("does not turn" in reason for reason in left_out)
    assert {round(math.degrees(row.slip_angle)) for row in rows} == {0, 15, 45}
    assert all(row.lateral_force > 0.0 for row in rows if row.slip_angle)
    cells = cells_of(rows)
    assert set(cells.replicates) == {2}
    assert len(rows) == 2 * len(cells.slip)
    with pytest.raises(WheelTableError, match="no column"):
        read_table(MEASURED / "README.md", "larger")


def test_two_settings_of_a_wheel_with_grousers_name_nothing(
    tmp_path: Path,
) -> None:
    out = tmp_path / "out"
    files = ["--wheel", str(MEASURED / "cmu_wheel.yaml"), "--soil", str(MEASURED / "cmu_soil.yaml")]
    tables = [
        "--wheel-table",
        str(MEASURED / "cmu_grousers.csv"),
        "--reference",
        str(MEASURED / "cmu_smooth.csv"),
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
    assert main([*tables, *files, *asked, "--out", str(out)]) == 0
    finding = json.loads((out / "finding.json").read_text(encoding="utf-8"))
    assert finding["verdict"] != "named"
    assert finding["gap"]["proven"] is None
    assert finding["fits"]["constants_as_measured"] is None
    # slip_sinkage gains less than a name needs, with an error of the law beside it
    assert finding["verdict"] == "none"
    assert finding["effects"] == []
