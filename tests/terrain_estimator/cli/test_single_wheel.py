# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What is found in single-wheel tables that were simulated with effects outside the library."""

import re
from pathlib import Path

import pytest

from terrain_estimator.cli.find_missing_effect import main
from tests.terrain_estimator.cli.wheel_tables import (
    LOADS,
    NOISE,
    RADIUS,
    SLIPS,
    Churned,
    Ploughed,
    found,
    table,
    with_slips,
)


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
