# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How single-wheel tables are read, and what of them and of the options is refused."""

import math
from pathlib import Path
from typing import Any

import pytest

from terrain_estimator.cli import single_wheel
from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.discovery.single_wheel.cells import cells_of
from terrain_estimator.discovery.single_wheel.table import WheelTableError, read_table, rim_slip
from tests.terrain_estimator.cli.wheel_tables import HEADER, TURNED


def test_rows_with_a_slip_angle_have_the_slip_along_the_wheel_and_need_a_lateral_force(
    tmp_path: Path,
) -> None:
    path = tmp_path / "turned.csv"
    state = "40,1.0,12,3,1"
    path.write_text(
        f"{TURNED}\n0.2,{state},0,0.4\n0.2,{state},60,4\n0.2,{state},-60,-4\n0.2,{state},90,4\n",
        encoding="utf-8",
    )
    rows, left_out = read_table(path, "rim")
    assert [row.slip for row in rows] == pytest.approx([0.2, 0.6, 0.6])
    assert [row.slip_angle for row in rows] == pytest.approx(
        [0.0, math.radians(60.0), math.radians(-60.0)]
    )
    assert [row.lateral_force for row in rows] == pytest.approx([math.nan, 4.0, -4.0], nan_ok=True)
    assert len(left_out) == 1
    assert "slip angle 90 deg: above 89 deg" in left_out[0]
    assert [row.slip_angle for row in read_table(path, "rim", "carriage", 0.0)[0]] == [0.0]
    assert cells_of(rows).seen.tolist() == [
        [True, True, False, False],
        [True, True, True, False],
        [True, True, True, False],
    ]
    assert [row.slip for row in read_table(path, "rim", "wheel")[0]] == pytest.approx(
        [0.2, 0.2, 0.2]
    )
    path.write_text(f"{HEADER},slip_angle_deg\n0.2,{state},0\n0.2,{state},15\n", encoding="utf-8")
    rows, left_out = read_table(path, "rim")
    assert len(rows) == 1
    assert "no column lateral_force_N" in left_out[0]
    path.write_text(f"{TURNED}\n0.2,{state},0,-9\n0.2,{state},15,-4\n", encoding="utf-8")
    with pytest.raises(WheelTableError, match="opposite signs"):
        read_table(path, "rim")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f"{HEADER}\n0.1,40,1.0,12,3,1\n0.2,40,1.0,deep,3,1\n",
            "bad.csv:3: column sinkage_mm: 'deep'",
        ),
        (f"{HEADER}\n0.1,40,1.0,12\n", "bad.csv:2: column drawbar_pull_N: ''"),
        (
            HEADER.replace("sinkage_mm", "sinkage_furlong") + "\n",
            "bad.csv:1: column 'sinkage_furlong': unknown unit",
        ),
        (HEADER.replace("drawbar_pull_N,", "") + "\n", "bad.csv:1: no column drawbar_pull_N"),
        (f"{HEADER}\n0.1,40,1.0,12,3,1\n", "1 settings can be used"),
        (
            f"{HEADER},sinkage_m\n0.1,40,1.0,12,3,1,0.01\n",
            "bad.csv:1: columns 'sinkage_mm' and 'sinkage_m' both say sinkage",
        ),
        (
            f"{HEADER}\n0,1,40,1,0,12,3,1\n",
            "bad.csv:2: 8 cells in 6 columns: write numbers with a point, not a comma",
        ),
        (
            f"{HEADER}\n0.1,0,1.0,12,3,1\n",
            "bad.csv:2: column normal_load_N: 0 N: a load is above zero",
        ),
        (
            f"{HEADER}\n0.1,40,-1.0,12,3,1\n",
            "bad.csv:2: column wheel_rate_rad_s: -1 rad/s: positive is rolling forward",
        ),
        (
            f"{HEADER}\n0.1,40,1.0,-12,3,1\n",
            "bad.csv: the mean sinkage is -0.012 m: a wheel that sinks has a positive one",
        ),
        (
            HEADER.replace(",", ";") + "\n0,1;40;1,0;12;3;1\n",
            "they are separated by ';': save it with commas between columns",
        ),
    ],
)
def test_a_table_that_cannot_be_read_is_refused_with_its_line_and_field(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    path, wheel = tmp_path / "bad.csv", tmp_path / "wheel.yaml"
    path.write_text(text, encoding="utf-8")
    wheel.write_text("name: testbed\nradius: 0.1\nwidth: 0.08\n", encoding="utf-8")
    assert main(["--wheel-table", str(path), "--wheel", str(wheel)]) == 2
    assert said in capsys.readouterr().err


def test_a_table_of_a_spreadsheet_is_read_and_one_of_another_encoding_is_refused(
    tmp_path: Path,
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(
        f"{HEADER},remark\n0.1,40,1.0,12,3,1,d\u00fcn\n0.2,40,1.0,12,3\n", encoding="utf-8-sig"
    )
    assert [(row.slip, row.trial) for row in read_table(path, "rim")[0]] == [(0.1, "1"), (0.2, "")]
    path.write_bytes(path.read_text(encoding="utf-8-sig").encode("latin-1"))
    with pytest.raises(WheelTableError, match=r"table.csv: is no CSV file in UTF-8"):
        read_table(path, "rim")


def test_an_effect_that_one_wheel_does_not_show_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wheel = tmp_path / "wheel.yaml"
    wheel.write_text("name: testbed\nradius: 0.1\nwidth: 0.08\n", encoding="utf-8")
    assert main(["--wheel-table", "none.csv", "--wheel", str(wheel), "--library", "payload"]) == 2
    assert "payload is not testable" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--hold-out-by", "trial"), "there is one trial"),
        (("--sinkage-sd", "0"), "--sinkage-sd 0: give a finite number above 0"),
        (("--sinkage-sd", "inf"), "--sinkage-sd inf: give a finite number above 0"),
        (("--constants-sd", "-1"), "--constants-sd -1"),
        (("--constants-sd", "20"), "--constants-sd 20: it is relative to each constant"),
        (("--pull-sd", "nan"), "--pull-sd nan"),
        (("--lateral-sd", "-1"), "--lateral-sd -1"),
        *(
            (
                (option, value),
                (
                    f"{option} {value}: no row that is used has a {row}, so it changes nothing:"
                    f" leave the option out, or give a table with a column {column}"
                ),
            )
            for option, value, row, column in (
                # of the default's size: given all the same
                ("--lateral-sd", "0.35", "lateral force", "lateral_force_N"),
                ("--lateral-offset-sd", "0.5", "lateral force", "lateral_force_N"),
                ("--reading-sd", "lateral_force=0.1", "lateral force", "lateral_force_N"),
                ("--torque-sd", "0.1", "torque", "torque_Nm"),
                ("--torque-offset-sd", "0.3", "torque", "torque_Nm"),
                ("--reading-sd", "torque=0.1", "torque", "torque_Nm"),
            )
        ),
        (
            ("--torque-constant-sd", "0.05"),
            "--torque-constant-sd 0.05: without --torque-constant no torque is read",
        ),
        (("--slip-speed", "wheel"), "--slip-speed wheel: no row that is used has a slip angle"),
        (
            ("--shear-box", "c=0.25+-0.1,tan_phi=0.62+-0.03"),
            "--shear-box: no row that is used has a torque",
        ),
        (
            ("--library", "grousers", "--prior-odds", "slip_sinkage=10"),
            "--prior-odds slip_sinkage=10: slip_sinkage is not looked for",
        ),
        (("--largest-slip-angle", "90"), "--largest-slip-angle 90: give 0 to 89 deg"),
        (
            ("--library", "lateral_bulldozing"),
            "lateral_bulldozing is not testable: no row has a slip angle",
        ),
    ],
)
def test_arguments_that_leave_nothing_to_fit_or_change_nothing_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str
) -> None:
    path, wheel = tmp_path / "table.csv", tmp_path / "wheel.yaml"
    path.write_text(
        f"{HEADER}\n"
        + "".join(
            f"{slip},40,1.0,{5 + 20 * slip},{10 * slip},1\n" for slip in (0.0, 0.1, 0.2, 0.4)
        ),
        encoding="utf-8",
    )
    wheel.write_text("name: testbed\nradius: 0.1\nwidth: 0.08\n", encoding="utf-8")
    assert main(["--wheel-table", str(path), "--wheel", str(wheel), *arguments]) == 2
    assert said in capsys.readouterr().err


def test_lines_without_entries_are_passed_over_and_a_wheel_that_stands_is_left_out(
    tmp_path: Path,
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(
        f"{HEADER}\r\n0.1,40,1.0,12,3,1\r\n\r\n0.3,40,0,12,3,1\r\n,,,,,\r\n", encoding="utf-8-sig"
    )
    rows, left_out = read_table(path, "rim")
    assert [row.slip for row in rows] == [0.1]
    assert left_out == [f"{path}:4: slip 0.3: the wheel does not turn"]


class AskedError(WheelTableError):
    """End of the command where the search would begin."""


def test_tables_of_one_name_in_two_folders_are_two_and_what_is_given_is_not_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wheel = tmp_path / "wheel.yaml"
    wheel.write_text("name: testbed\nradius: 0.1\nwidth: 0.08\n", encoding="utf-8")
    tables = [tmp_path / folder / "day 1.csv" for folder in ("smooth", "grous\u00e9red")]
    for depth, table_path in enumerate(tables, 5):
        table_path.parent.mkdir()
        states = ((slip, depth + 20 * slip, 10 * slip) for slip in (0.0, 0.1, 0.2, 0.4))
        lines = (f"{slip},40,1.0,{sinkage},{pull},1\n" for slip, sinkage, pull in states)
        table_path.write_text(f"{HEADER}\n" + "".join(lines), encoding="utf-8")
    seen: list[Any] = []

    def search(*asked: Any, **_: Any) -> None:
        seen.extend(asked)
        raise AskedError

    monkeypatch.setattr(single_wheel, "investigate_wheel", search)
    smooth, grousered = map(str, tables)
    place = ["--wheel", str(wheel), "--out", str(tmp_path / "out")]
    assert (
        main(
            [
                f"--wheel-table={grousered}",
                "--reference",
                smooth,
                "--given",
                "slip_sinkage, bulldozing",
                *place,
            ]
        )
        == 2
    )
    _, rows, reference, given, names, *_ = seen
    assert cells_of(rows, reference).acts.tolist() == [True] * 4 + [False] * 4
    assert given.names == ("slip_sinkage", "bulldozing")
    assert set(names) == {"grousers", "rate_dependence", "exit_angle"}
    capsys.readouterr()
    for arguments, said in (
        (["--reference", grousered], f"{grousered} is given twice"),
        (
            ["--given", "grousers", "--library", "grousers"],
            "grousers is in --library and in --given",
        ),
        (["--out", str(wheel)], f"{wheel}: is a file, not a folder"),
    ):
        assert main(["--wheel-table", grousered, *place, *arguments]) == 2
        assert said in capsys.readouterr().err
    assert len(seen) == 6
    wheel.write_text("name: testbed\nradius: 100\nwidth: 80\n", encoding="utf-8")
    assert main(["--wheel-table", grousered, *place]) == 2
    assert (
        "wheel.yaml: radius: 100 is outside its range: a finite number above 0 and at most 2 [m]"
        in capsys.readouterr().err
    )


def test_slip_of_a_braked_wheel_is_converted() -> None:
    assert rim_slip(0.5, "larger") == pytest.approx(0.5)
    assert rim_slip(-0.2, "larger") == pytest.approx(-0.25)
    assert rim_slip(-1.0, "larger") is None
    assert rim_slip(-0.25, "rim") == pytest.approx(-0.25)
