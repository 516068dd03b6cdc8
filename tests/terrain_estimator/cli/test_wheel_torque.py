# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Single-wheel tables with torque: c and tan phi, zeros of sensors, and a measured wheel's lugs."""

import csv
import dataclasses
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


def table(path: Path, pull_offset: float = 0.0, motor: tuple[float, float] | None = None) -> Path:
    """Write steady states on loose sand with another c and tan phi, the pull off by newtons.

    With a ``motor`` of a constant [N m/A] and a friction [N m], its current stands for the torque.
    """
    generator = torch.Generator().manual_seed(3)
    soil = load_soil("loose_sand")
    bed = Rig(
        wheel_alone(load_rover("mars_rover"), RADIUS, WIDTH), soil, (0.05,) * 5, (*NOISE, 1.0)
    )
    rows = [Row("t", "1", slip, load, 0.5 + slip, 0.01, 0.0) for load in LOADS for slip in SLIPS]
    strength = torch.tensor([[COHESION_PA, TAN_PHI]], dtype=torch.float64)
    states = bed.states(cells_of(rows), strength, soil.constants().unsqueeze(0), [])[0]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(
            HEADER.replace("torque_Nm", "current_A" if motor else "torque_Nm").split(",")
        )
        for row, state in zip(rows, states[:, [0, 1, 3]], strict=True):
            noise = torch.randn(3, generator=generator, dtype=torch.float64)
            depth, pull, torque = (state + noise * torch.tensor(NOISE)).tolist()
            if motor:
                torque = (torque + motor[1]) / motor[0]
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


def strength(finding: dict[str, Any]) -> dict[str, Any]:
    """Return c and tan phi with the constants as measured."""
    found: dict[str, Any] = finding["fits"]["constants_as_measured"]
    return found


def holds(found: dict[str, Any]) -> bool:
    """Whether both 95 % intervals hold the truth."""
    cohesion, tan_phi = found["cohesion_pa"], found["tan_phi"]
    return bool(
        cohesion["low"] < COHESION_PA < cohesion["high"]
        and tan_phi["low"] < TAN_PHI < tan_phi["high"]
    )


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The finding about the table as it is, without more options."""
    return found(table(tmp_path_factory.mktemp("plain") / "table.csv"))


def test_with_a_torque_both_fits_say_how_the_law_fits_and_what_c_and_tan_phi_are(
    plain: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    finding = found(table(tmp_path / "table.csv"), "--shear-box", "c=1.4+-0.2,tan_phi=0.52+-0.03")
    assert finding["verdict"] == "none"
    assert finding["rows"] == ["sinkage", "drawbar_pull", "torque"]
    soil = strength(finding)
    assert soil == strength(plain)  # the shear box does not change it
    assert holds(soil)
    assert soil["tan_phi"]["high"] - soil["tan_phi"]["low"] < 0.3
    assert soil["rejected"] == []
    assert soil["effective_draws"] > 100.0
    free = finding["fits"]["constants_free"]["rows"]
    assert list(free) == finding["rows"]
    for (row, each), noise in zip(free.items(), NOISE, strict=True):
        assert each["rms"] < 1.5 * noise, row
    assert finding["gap"]["rows"]["torque"]["unit"] == "N m"
    said = capsys.readouterr().out
    assert "shear box 1.4 kPa +- 0.2 kPa" in said
    assert "shear box 0.52 +- 0.03" in said
    report = (tmp_path / "out" / "report.html").read_text()
    assert all(line in report for line in said.splitlines() if line.startswith("Constants"))


def test_a_motors_current_is_a_torque_whose_gain_and_friction_are_free(tmp_path: Path) -> None:
    """The constant is stated 12 % too small, the friction not at all."""
    path = table(tmp_path / "table.csv", motor=(2.24, 0.3))
    stated = ("--torque-constant", "2.0", "--torque-offset-sd", "0.3")
    finding = found(path, *stated)
    assert finding["verdict"] == "none"
    soil = strength(finding)
    assert holds(soil)
    assert soil["model_error"]["torque"]["median"] < 2.0 * NOISE[2]
    _, left_out = read_table(path, "rim")
    assert left_out == [f"{path}:1: column current_A is not used: give --torque-constant [N m/A]"]


def test_other_columns_of_a_current_are_ignored(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"{HEADER},current_limit_A\n0.2,40,0.5,5,3,1.0,9\n", encoding="utf-8")
    ((row,), left_out) = read_table(path, "rim")
    assert (row.torque, left_out) == (1.0, [])


@pytest.mark.parametrize(
    ("header", "option", "words"),
    [
        ("torque_Nm", ("--torque-constant", "2"), "no column current_A or current_mA"),
        ("torque_Nm,current_A", ("--torque-constant", "2"), "both say the torque"),
        ("current_A", ("--torque-constant", "-2"), "it is above zero and finite"),
        ("current_A", ("--torque-constant-sd", "1"), "give 0 to less than 1"),
    ],
)
def test_a_current_that_cannot_be_a_torque_is_refused(
    header: str,
    option: tuple[str, str],
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, wheel = tmp_path / "table.csv", tmp_path / "wheel.yaml"
    wheel.write_text(f"name: bed\nradius: {RADIUS}\nwidth: {WIDTH}\n", encoding="utf-8")
    ones = ",1" * len(header.split(","))
    path.write_text(f"{HEADER.replace('torque_Nm', header)}\n0.2,40,0.5,5,3{ones}\n", "utf-8")
    files = ["--wheel-table", str(path), "--wheel", str(wheel), "--out", str(tmp_path / "out")]
    assert main([*files, *option]) == 2
    assert words in capsys.readouterr().err


def test_a_measured_constant_that_is_wrong_is_named_with_both_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The soil file's K is five times the plant's, and said to be known to 5 %."""
    soil = load_soil("loose_sand")
    path = tmp_path / "soil.yaml"
    values = dataclasses.asdict(soil) | {"shear_modulus": 5.0 * soil.shear_modulus}
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items()))
    finding = found(table(tmp_path / "table.csv"), "--soil", str(path))
    (rejected,) = strength(finding)["rejected"]
    assert rejected["name"] == "shear_modulus"
    assert rejected["measured"] == pytest.approx(values["shear_modulus"])
    assert rejected["fitted"]["low"] < soil.shear_modulus < rejected["fitted"]["high"]
    assert rejected["deviations"] > 3.0
    said = capsys.readouterr().out
    assert "The tables contradict the measured shear_modulus" in said
    assert "do not rely on c and tan phi" in said


def test_a_wrong_zero_is_a_model_error_unless_it_is_free(tmp_path: Path) -> None:
    """The drawbar pull is 15 of its deviations too large in every row."""
    path = table(tmp_path / "table.csv", 3.0)
    errors = [
        strength(found(path, *free))["model_error"]["drawbar_pull"]["median"]
        for free in ((), ("--pull-offset-sd", "3"))
    ]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    ("option", "text", "words"),
    [
        ("--shear-box", "c=0.25", "give both values with their deviations"),
        ("--shear-box", "c=0.25+-0.1,tan_phi=0.6+-x", "--shear-box: 'x' is no finite number"),
        ("--shear-box", "c=-1+-0.1,tan_phi=0.6+-0.1", "none negative"),
        ("--constants-sd", "0.2,kk=0.1", "--constants-sd 'kk=0.1': unknown name"),
        ("--constants-sd", "0.2,n=0", "--constants-sd 0: the deviation of n must be above zero"),
        ("--reading-sd", "pull=0.5", "--reading-sd 'pull=0.5': unknown name"),
        ("--lateral-offset-sd", "-1", "--lateral-offset-sd -1: give a finite number, 0 or above"),
        ("--pull-offset-sd", "inf", "--pull-offset-sd inf: give a finite number, 0 or above"),
        ("--torque-offset-sd", "nan", "--torque-offset-sd nan: give a finite number, 0 or above"),
        ("--reading-sd", "slip=-1", "--reading-sd slip=-1: a standard deviation is not negative"),
        ("--slip-radius", "lug", "hit_wheel.yaml has no lug_height"),
    ],
)
def test_a_wrong_option_is_refused_with_what_to_do(
    option: str, text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ["--wheel", str(MEASURED / "hit_wheel.yaml"), "--out", str(tmp_path / "out")]
    tables = ["--wheel-table", str(MEASURED / "hit_smooth.csv")]
    assert main([*tables, *files, option, text]) == 2
    assert words in capsys.readouterr().err


def misread(path: Path, slip: float) -> None:
    """Shift the slips of a table up and down in turn, as a reader of a figure might."""
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    cells = [row.split(",") for row in rows]
    for k, each in enumerate(cells):
        each[0] = str(float(each[0]) + slip * (-1.0) ** k)
    path.write_text("\n".join([head, *map(",".join, cells)]), encoding="utf-8")


def test_a_stated_error_of_reading_slips_enters_the_held_out_test(tmp_path: Path) -> None:
    """Slips 0.01 off move the drawbar pull by several of its deviations."""
    path = table(tmp_path / "table.csv")
    misread(path, 0.01)
    exact, read = found(path), found(path, "--reading-sd", "slip=0.01")
    assert not exact["gap"]["described"]
    assert read["gap"]["described"]
    assert holds(strength(read))


def test_an_error_of_reading_a_force_adds_to_its_repeatability(tmp_path: Path) -> None:
    gap = found(table(tmp_path / "table.csv"), "--reading-sd", "drawbar_pull=0.3")["gap"]
    assert gap["rows"]["drawbar_pull"]["noise_floor"] == pytest.approx((0.2**2 + 0.3**2) ** 0.5)
    assert gap["rows"]["torque"]["noise_floor"] == NOISE[2]


def test_a_slip_by_the_lugs_tips_is_converted_to_that_of_the_rim(tmp_path: Path) -> None:
    """Slip 0.2 at a tip of 1.1 r: V = 0.8 * 1.1 r w, so the rim's slip is 0.12."""
    path = tmp_path / "table.csv"
    path.write_text(f"{HEADER}\n0.2,40,0.5,5,3,1.0\n", encoding="utf-8")
    ((row,), _) = read_table(path, "rim", radius_ratio=1.1)
    assert row.slip == pytest.approx(0.12)
    ((row,), _) = read_table(path, "rim")
    assert row.slip == 0.2


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
    assert "slip_sinkage, which is taken to act in all" in capsys.readouterr().out


def test_prior_odds_multiply_the_probability_and_stand_in_the_report(tmp_path: Path) -> None:
    (tmp_path / "odds").mkdir()
    usual = found(table(tmp_path / "table.csv"))
    likelier = found(table(tmp_path / "odds" / "table.csv"), "--prior-odds", "slip_sinkage=10")
    ratios = [
        each["probabilities"]["slip_sinkage"] / each["probabilities"]["none"]
        for each in (usual, likelier)
    ]
    assert ratios[1] == pytest.approx(10.0 * ratios[0], rel=1e-6)
    assert likelier["asked"]["prior_odds"] == {"slip_sinkage": 10.0}
    pages = [
        (tmp_path / part / "out" / "report.html").read_text(encoding="utf-8")
        for part in ("", "odds")
    ]
    said = "Stated by the user before the search, as odds over what is usual"
    assert [said in page for page in pages] == [False, True]
