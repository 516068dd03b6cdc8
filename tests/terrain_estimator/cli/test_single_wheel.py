# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Single-wheel tables: simulated with effects outside the library, and broken ones."""

import csv
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from terrain_estimator.cli import single_wheel
from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.discovery.single_wheel.cells import ROWS, Rig, Row, cells_of, wheel_alone
from terrain_estimator.discovery.single_wheel.table import WheelTableError, read_table, rim_slip
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import (
    ContactInputs,
    Effect,
    Situation,
    with_stiffness,
)

RADIUS, WIDTH = 0.1, 0.08
SLIPS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.65)
LOADS = (40.0, 90.0)
NOISE = (0.2e-3, 0.2, 0.1)
HEADER = "slip,normal_load_N,wheel_rate_rad_s,sinkage_mm,drawbar_pull_N,trial"
TURNED = f"{HEADER},slip_angle_deg,lateral_force_N"


class Churned(Effect):
    """Soil that softens below a slipping wheel in its exponent, unlike the library's law."""

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        del where
        return with_stiffness(contact, 1.0 / (1.0 + 8.0 * contact.slip.abs()))


class Ploughed(Effect):
    """Soil pushed by the wheel's side with Rankine's passive pressure over the chord.

    The library integrates along the rim.
    """

    def push(self, where: Situation, contact: ContactInputs, forces: torch.Tensor) -> torch.Tensor:
        if contact.slip_angle is None:
            return forces
        depth = contact.sinkage
        chord = 2.0 * torch.sqrt(2.0 * where.rover.wheel_radius * depth)
        side = (0.5 * 15e3 * 3.0 * depth**2 + 2.0 * 500.0 * 3.0**0.5 * depth) * chord
        return torch.cat(
            [
                forces[..., :3],
                forces[..., 3:] + (side * torch.sin(contact.slip_angle)).unsqueeze(-1),
            ],
            -1,
        )


def table(
    path: Path,
    effects: list[Effect],
    speeds: tuple[float, ...],
    slips: tuple[float, ...] = SLIPS,
    angles: tuple[float, ...] = (0.0,),
    lateral_offset: float = 0.0,
) -> Path:
    """Return two replicates of every setting, of a soil with constants off by 5 %.

    Slip angles are in degrees, with the carriage's slip; the lateral force is off by newtons.
    """
    generator = torch.Generator().manual_seed(3)
    soil = load_soil("loose_sand")
    bed = Rig(wheel_alone(load_rover("mars_rover"), RADIUS, WIDTH), soil, (0.05,) * 5, NOISE)
    settings = [
        (slip, load, speeds[k % len(speeds)], math.radians(angle))
        for angle in angles
        for load in LOADS
        for k, slip in enumerate(slips)
    ]
    rows = [
        Row(
            "t",
            "1",
            slip,
            load,
            speed * math.cos(angle) / RADIUS / (1.0 - slip),
            0.01,
            0.0,
            angle,
            0.0,
        )
        for slip, load, speed, angle in settings
    ]
    constants = soil.constants() * torch.tensor(
        [1.02, 1.0, 0.95, 1.05, 1.0, 1.0], dtype=torch.float64
    )
    states = bed.states(
        cells_of(rows), soil.strength().unsqueeze(0), constants.unsqueeze(0), effects
    )[0]
    states[:, ROWS.index("lateral_force")] += lateral_offset
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow((TURNED if any(angles) else HEADER).split(","))
        for row, state in zip(rows, states, strict=True):
            for trial in (1, 2):
                count = 3 if any(angles) else 2
                noise = torch.tensor(NOISE[:count]) * torch.randn(
                    count, generator=generator, dtype=torch.float64
                )
                depth, pull, *lateral = (state[:count] + noise).tolist()
                slip = 1.0 - (1.0 - row.slip) / math.cos(row.slip_angle)
                turned = [math.degrees(row.slip_angle), *lateral][: 2 * len(lateral)]
                writer.writerow(
                    [slip, row.load, row.wheel_rate, 1e3 * depth + 3.0, pull, trial, *turned]
                )
    return path


def with_slips(path: Path, folder: str, other: Callable[[float], float]) -> Path:
    """Return a table in a new folder beside this one, whose slips are other functions of these."""
    head, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
    copy = path.parent / folder / path.name
    copy.parent.mkdir()
    with copy.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([head, *([other(float(row[0])), *row[1:]] for row in rows)])
    return copy


def found(path: Path, *extra: str, lug_height: float = 0.0) -> dict[str, Any]:
    wheel = path.with_name("wheel.yaml")
    lines = ["name: testbed", f"radius: {RADIUS}", f"width: {WIDTH}", f"lug_height: {lug_height}"]
    wheel.write_text("\n".join(lines), encoding="utf-8")
    noise = [
        "--sinkage-sd",
        str(NOISE[0]),
        "--pull-sd",
        str(NOISE[1]),
        "--lateral-sd",
        str(NOISE[2]),
        "--constants-sd",
        "0.05",
    ]
    out = path.with_suffix("")
    assert (
        main(["--wheel-table", str(path), "--wheel", str(wheel), *noise, "--out", str(out), *extra])
        == 0
    )
    content: dict[str, Any] = json.loads((out / "finding.json").read_text(encoding="utf-8"))
    return content


def test_softening_with_slip_is_named_where_the_speed_varies_and_helps_on_held_out_settings(
    tmp_path: Path,
) -> None:
    finding = found(
        table(tmp_path / "churned.csv", [Churned()], (0.05, 0.2)),
        "--library",
        "slip_sinkage,rate_dependence",
    )
    assert finding["verdict"] == "named"
    assert [each["name"] for each in finding["effects"]] == ["slip_sinkage"]
    gap = finding["gap"]
    assert gap["proven"] is True
    for row in ("sinkage", "drawbar_pull"):
        assert gap["rows"][row]["after"] < gap["rows"][row]["before"], row
    assert finding["settings"] == len(SLIPS) * len(LOADS)
    assert finding["measurements"] == 2 * finding["settings"]
    assert finding["fits"]["constants_as_measured"] is None
    assert "not identified" in finding["fits"]["why"]
    assert sum(finding["probabilities"].values()) == pytest.approx(1.0, abs=1e-9)


def test_at_one_speed_what_goes_with_slip_may_go_with_wheel_rate(tmp_path: Path) -> None:
    path = table(tmp_path / "one_speed.csv", [Churned()], (0.1,))
    finding = found(path, "--library", "slip_sinkage,rate_dependence", "--hold-out-by", "trial")
    assert finding["verdict"] == "confusable"
    assert {each["name"] for each in finding["effects"]} == {"slip_sinkage", "rate_dependence"}
    assert "two speeds" in finding["separate_by"]


def test_where_nothing_is_missing_nothing_is_named(tmp_path: Path) -> None:
    finding = found(
        table(tmp_path / "nominal.csv", [], (0.05, 0.2)),
        "--library",
        "slip_sinkage,bulldozing",
        "--hold-out-by",
        "trial",
    )
    assert finding["verdict"] == "none"
    assert finding["gap"]["described"] is True


def test_errors_far_beyond_repeatability_are_in_the_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    finding = found(
        table(tmp_path / "scattered.csv", [], (0.05, 0.2)),
        *("--library", "slip_sinkage", "--hold-out-by", "trial"),
        *("--sinkage-sd", "1e-5", "--pull-sd", "0.01"),
    )
    assert finding["gap"]["before"] > 5.0
    assert finding["gap"]["described"] is False
    assert "the model does not describe these tables" in capsys.readouterr().out
    page = (tmp_path / "scattered" / "report.html").read_text(encoding="utf-8")
    headline = re.search("<h1>(.*)</h1>", page)
    assert headline
    assert "model does not describe these tables" in headline[1]


def test_a_side_that_ploughs_is_named_and_the_lateral_force_of_another_trial_is_met_better(
    tmp_path: Path,
) -> None:
    path = table(
        tmp_path / "ploughed.csv", [Ploughed()], (0.05, 0.2), (0.1, 0.35, 0.6), (0.0, 20.0, -40.0)
    )
    finding = found(path, "--library", "lateral_bulldozing,bulldozing", "--hold-out-by", "trial")
    assert finding["verdict"] == "named"
    assert [each["name"] for each in finding["effects"]] == ["lateral_bulldozing"]
    assert finding["effects"][0]["unit"] == "N/m^3"
    lateral = finding["gap"]["rows"]["lateral_force"]
    assert lateral["after"] < 0.5 * lateral["before"]
    assert finding["settings"] == 18
    report = path.with_suffix("").joinpath("report.html").read_text(encoding="utf-8")
    assert "The model lacks lateral_bulldozing" in report
    assert "<svg" in report


def test_where_no_side_ploughs_none_is_named(tmp_path: Path) -> None:
    path = table(tmp_path / "turned.csv", [], (0.05, 0.2), (0.1, 0.35, 0.6), (0.0, 20.0, -40.0))
    finding = found(path, "--library", "lateral_bulldozing", "--hold-out-by", "trial")
    assert finding["verdict"] == "none"
    assert finding["rows"] == ["sinkage", "drawbar_pull", "lateral_force"]
    assert finding["gap"]["rows"]["lateral_force"]["before"] < 4.0 * NOISE[2]


def test_a_wrong_zero_of_the_lateral_force_is_learnt_from_the_other_settings_where_it_is_free(
    tmp_path: Path,
) -> None:
    """The lateral force is ten of its deviations too large to both sides."""
    angles = (20.0, -40.0)
    path = table(tmp_path / "t.csv", [], (0.05, 0.2), (0.1, 0.35, 0.6), angles, 10.0 * NOISE[2])
    known, free = (
        found(path, "--library", "bulldozing", *option)["gap"]["rows"]["lateral_force"]["before"]
        for option in ((), ("--lateral-offset-sd", str(10.0 * NOISE[2])))
    )
    assert known > 5.0 * NOISE[2]
    assert free < 2.0 * NOISE[2]


def test_a_zero_of_a_lateral_force_that_is_left_out_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, wheel = table(tmp_path / "t.csv", [], (0.05,), angles=(0.0, 20.0)), tmp_path / "w.yaml"
    wheel.write_text("name: testbed\nradius: 0.1\nwidth: 0.08\n", encoding="utf-8")
    straight = ["--largest-slip-angle", "0", "--lateral-offset-sd", "0.5"]
    assert main(["--wheel-table", str(path), "--wheel", str(wheel), *straight]) == 2
    assert "--lateral-offset-sd 0.5: no row that is used has a lateral" in capsys.readouterr().err


def test_slips_by_the_lugs_tips_give_what_they_give_converted_by_hand(tmp_path: Path) -> None:
    """The speed is (1 - slip) r w with either radius, so the rim slips less than the tips."""
    lug_height = 0.25 * RADIUS
    ratio = (RADIUS + lug_height) / RADIUS
    rim = table(tmp_path / "table.csv", [], (0.05, 0.2), SLIPS[1:])
    tips = with_slips(rim, "tips", lambda slip: 1.0 - (1.0 - slip) / ratio)
    by_hand = with_slips(tips, "by_hand", lambda slip: 1.0 - (1.0 - slip) * ratio)
    asked = ("--library", "slip_sinkage", "--hold-out-by", "trial")
    converted = found(tips, *asked, "--slip-radius", "lug", lug_height=lug_height)
    assert converted == found(by_hand, *asked)
    slips = {round(slip, 9) for slip in converted["gap"]["points"]["slip"]}
    assert slips == set(SLIPS[1:])


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
        (
            ("--lateral-offset-sd", "0.5"),
            (
                "--lateral-offset-sd 0.5: no row that is used has a lateral force, so its zero"
                " changes nothing: leave the option out, or give a table with a column lateral_"
            ),
        ),
        (
            ("--torque-offset-sd", "0.3"),
            (
                "--torque-offset-sd 0.3: no row that is used has a torque, so its zero changes"
                " nothing: leave the option out, or give a table with a column torque_Nm"
            ),
        ),
        (("--largest-slip-angle", "90"), "--largest-slip-angle 90: give 0 to 89 deg"),
        (
            ("--library", "lateral_bulldozing"),
            "lateral_bulldozing is not testable: no row has a slip angle",
        ),
    ],
)
def test_arguments_that_leave_nothing_to_fit_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, str], said: str
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
