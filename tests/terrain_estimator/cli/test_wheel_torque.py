# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Single-wheel tables with torque: c and tan phi, zeros of sensors, and a measured wheel's lugs."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest
import torch

from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.discovery.single_wheel.cells import Rig, Row, cells_of, wheel_alone
from terrain_estimator.discovery.single_wheel.table import WheelTableError, read_table
from terramechanics.presets import load_rover, load_soil

MEASURED = Path(__file__).parents[3] / "bags" / "measured"
RADIUS, WIDTH = 0.1, 0.08
SLIPS, LOADS = (0.05, 0.15, 0.3, 0.45, 0.6), (40.0, 90.0)
NOISE = (0.2e-3, 0.2, 0.02)
COHESION_PA, TAN_PHI = 1500.0, 0.5
LUGS = (
    *("--wheel-table", str(MEASURED / "hit_lugs.csv")),
    *("--reference", str(MEASURED / "hit_smooth.csv")),
    *("--wheel", str(MEASURED / "hit_wheel.yaml"), "--soil", str(MEASURED / "hit_soil.yaml")),
    *("--sinkage-sd", "0.0005", "--pull-sd", "0.5", "--torque-sd", "0.1"),
    *("--pull-offset-sd", "2", "--torque-offset-sd", "0.3"),
)
"""The measured wheel with lugs beside its smooth rim, with errors of reading and free zeros."""
HEADER = "slip,normal_load_N,wheel_rate_rad_s,sinkage_mm,drawbar_pull_N,torque_Nm"


def table(path: Path, pull_offset: float = 0.0) -> Path:
    """Write steady states on loose sand with another c and tan phi, the pull off by newtons."""
    generator = torch.Generator().manual_seed(3)
    soil = load_soil("loose_sand")
    bed = Rig(wheel_alone(load_rover("mars_rover"), RADIUS, WIDTH), soil, 0.05, (*NOISE, 1.0))
    rows = [Row("t", "1", slip, load, 0.5 + slip, 0.01, 0.0) for load in LOADS for slip in SLIPS]
    strength = torch.tensor([[COHESION_PA, TAN_PHI]], dtype=torch.float64)
    states = bed.states(cells_of(rows), strength, soil.constants().unsqueeze(0), [])[0]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER.split(","))
        for row, state in zip(rows, states[:, [0, 1, 3]], strict=True):
            noise = torch.randn(3, generator=generator, dtype=torch.float64)
            depth, pull, torque = (state + noise * torch.tensor(NOISE)).tolist()
            writer.writerow(
                [row.slip, row.load, row.wheel_rate, 1e3 * depth, pull + pull_offset, torque]
            )
    return path


def found(path: Path, *more: str) -> dict[str, Any]:
    """Return the finding about a table."""
    wheel = path.with_name("wheel.yaml")
    wheel.write_text(f"name: bed\nradius: {RADIUS}\nwidth: {WIDTH}\n", encoding="utf-8")
    deviations = ["--sinkage-sd", str(NOISE[0]), "--pull-sd", str(NOISE[1])]
    deviations += ["--torque-sd", str(NOISE[2]), "--constants-sd", "0.05"]
    place = ["--wheel", str(wheel), "--soil", "loose_sand", "--out", str(path.with_name("out"))]
    library = ["--library", "slip_sinkage"]
    assert main(["--wheel-table", str(path), *deviations, *place, *library, *more]) == 0
    finding: dict[str, Any] = json.loads(path.with_name("out").joinpath("finding.json").read_text())
    return finding


def holds(parameters: dict[str, Any]) -> bool:
    """Whether both 99 % intervals hold the truth and the data narrow the prior."""
    before = parameters["before"]
    near = (
        abs(before["cohesion_pa"] - COHESION_PA) < 2.58 * before["cohesion_sd_pa"],
        abs(before["tan_phi"] - TAN_PHI) < 2.58 * before["tan_phi_sd"],
        before["tan_phi_sd"] < 0.1,
    )
    return all(near)


def test_with_a_torque_c_and_tan_phi_are_reported_where_the_model_describes_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    finding = found(table(tmp_path / "table.csv"))
    assert finding["verdict"] == "none"
    assert finding["rows"] == ["sinkage", "drawbar_pull", "torque"]
    assert holds(finding["parameters"])
    assert finding["gap"]["rows"]["torque"]["unit"] == "N m"
    assert "95 % intervals" in capsys.readouterr().out


def test_a_wrong_zero_is_refused_unless_it_is_free(tmp_path: Path) -> None:
    """The drawbar pull is 15 of its deviations too large in every row."""
    path = table(tmp_path / "table.csv", 3.0)
    parameters = found(path)["parameters"]
    assert parameters["before"] is None or not holds(parameters)
    assert holds(found(path, "--pull-offset-sd", "3")["parameters"])


@pytest.mark.parametrize(
    ("header", "torque", "words"),
    [
        ("torque_lbft", "1.0", "unknown unit 'lbft'; known are torque_Nm"),
        ("torque_Nm", "-1.0", "torque is negative where the wheel slips forward"),
    ],
)
def test_a_torque_in_another_unit_or_sign_is_refused(
    header: str, torque: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "table.csv"
    lines = [HEADER.replace("torque_Nm", header), f"0.2,40,0.5,5,3,{torque}"]
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(WheelTableError, match=words):
        read_table(path, "rim")


def test_a_copy_of_a_table_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lugs, copy = MEASURED / "hit_lugs.csv", tmp_path / "smooth.csv"
    copy.write_bytes(lugs.read_bytes())
    files = ["--wheel", str(MEASURED / "hit_wheel.yaml"), "--soil", str(MEASURED / "hit_soil.yaml")]
    tables = ["--wheel-table", str(lugs), "--reference", str(copy)]
    assert main([*tables, *files, "--out", str(tmp_path / "out")]) == 2
    assert "smooth.csv have 6 of 6 rows in common" in capsys.readouterr().err


def test_what_the_reference_lacks_itself_is_not_looked_for_as_the_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The smooth rim lacks slip_sinkage; without another effect nothing is left to search."""
    assert main([*LUGS, "--library", "slip_sinkage", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "alone lack slip_sinkage, so it is not what differs" in said


def test_the_lugs_of_a_measured_wheel_are_named_beside_its_smooth_rim(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ding's wheel: what the smooth rim lacks acts in both tables, and the lugs are what is left.

    Reading errors are those of the traced figure; the zeros of both forces are free.
    """
    assert main([*LUGS, "--out", str(tmp_path / "out")]) == 0
    finding = json.loads((tmp_path / "out" / "finding.json").read_text())
    assert finding["asked"]["reference_lacks"] == ["slip_sinkage"]
    assert finding["given"] == []
    assert (finding["verdict"], finding["effects"][0]["name"]) == ("named", "grousers")
    pull = finding["gap"]["rows"]["drawbar_pull"]
    assert pull["before"] > 4.0
    assert pull["after"] < 1.5
    assert finding["parameters"]["before"] is None, "the sinkage is not described"
    assert "slip_sinkage, which is taken to act in all" in capsys.readouterr().out
