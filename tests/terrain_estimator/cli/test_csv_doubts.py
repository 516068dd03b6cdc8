# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Values, wheels and rates that a CSV file cannot mean are named with what to do."""

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.terrain_estimator.cli.csv_files import HEADER, ROWS, mapping, messages, run


def rows(count: int, rate_hz: float = 10.0, **columns: float) -> list[str]:
    """Return a file of equal rows at a rate, in the units of the mapping."""
    row = {"v": 100.0, "p": 2.0, "a": 0.1, "s1": 10, "s2": -20, "z1": 12, "z2": 11}
    row |= {"w1": 62, "w2": 45, "q1": 5, "q2": 6} | columns
    values = ",".join(f"{row[name]:g}" for name in HEADER.split(",")[1:])
    return [HEADER, *(f"{1 + step / rate_hz:.6f},{values}" for step in range(count))]


@pytest.mark.parametrize(
    ("changes", "columns", "words"),
    [
        (
            {"slip": {"unit": "1", "noise": {"absolute": 0.01}}, "slip_definition": None},
            {},
            "slip is 10 in the median, above 1, that of a wheel that spins on the spot: set",
        ),
        (
            {"slip_definition": None},
            {"s1": 0.1, "s2": -0.2},
            "slip: the velocity and the wheel rates give",
        ),
        (
            {"sinkage": {"unit": "m", "noise": {"absolute": 0.01}}},
            {},
            "sinkage is 12 m in the median, above the wheel radius 0.017 m: set sinkage.unit: mm",
        ),
        (
            {"velocity": {"column": "v", "unit": "m/s", "noise": {"absolute": 2.0}}},
            {"v": 0.36},
            "times that of the wheels, r w (1 - slip) with r = 0.017 m: set velocity.unit: km/h",
        ),
        (
            {"wheel_rate": {"unit": "rad/s"}},
            {},
            "or wheel_rate.unit: rpm in the mapping, or give the right rover",
        ),
        ({}, {"w1": 372, "w2": 270}, "set wheel_rate.unit: deg/s in the mapping"),
        ({}, {"w1": -62, "w2": -45}, "velocity and wheel_rate have opposite signs"),
        (
            {
                "pitch": {
                    "column": "p",
                    "unit": "rad",
                    "positive": "nose_up",
                    "noise": {"absolute": 0.5},
                }
            },
            {},
            "column 'p': pitch is 2 rad in the median, steeper than a wall: set pitch.unit: deg",
        ),
        ({}, {"a": 9.8}, "column 'a': acceleration is 9.8 g in the median, above three times"),
        (
            {"torque": {"unit": "N m", "noise": {"absolute": 1}}},
            {},
            "column 'q1': torque is 5 N m in the median",
        ),
    ],
)
def test_impossible_values_name_column_value_and_the_unit_that_fits(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, Any],
    columns: dict[str, float],
    words: str,
) -> None:
    assert run(tmp_path, mapping(), rows(20)) == 0, capsys.readouterr().err
    (tmp_path / "bag").rename(tmp_path / "plain")
    assert run(tmp_path, mapping(**changes), rows(20, **columns)) == 2
    assert words in (error := capsys.readouterr().err), error
    assert not (tmp_path / "bag").exists()


def on_slopes(sign: float, steepest_deg: float = 4.0) -> list[str]:
    """Return rows over hills; the mapping's pitch is positive nose down, its acceleration in g."""
    draw, lines = np.random.default_rng(3), rows(200)
    for k in range(1, len(lines)):
        cells = lines[k].split(",")
        up = np.radians(steepest_deg) * np.sin(k / 20.0)
        cells[2] = f"{sign * np.degrees(-up) + draw.normal(0.0, 0.3):.4f}"
        cells[3] = f"{np.sin(up) + draw.normal(0.0, 0.002):.5f}"
        lines[k] = ",".join(cells)
    return lines


@pytest.mark.parametrize(
    ("changes", "sign", "words"),
    [
        ({}, -1.0, "pitch and acceleration have opposite signs"),
        (
            {"acceleration": {"column": "a", "unit": "m/s^2", "noise": {"absolute": 0.01}}},
            1.0,
            "times that of gravity on the slopes, g sin(pitch): set acceleration.unit: g",
        ),
    ],
)
def test_an_acceleration_that_is_not_gravity_s_on_slopes_is_named(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, Any],
    sign: float,
    words: str,
) -> None:
    assert run(tmp_path, mapping(), on_slopes(1.0)) == 0, capsys.readouterr().err
    (tmp_path / "bag").rename(tmp_path / "plain")
    assert run(tmp_path, mapping(**changes), on_slopes(sign)) == 2
    assert words in (error := capsys.readouterr().err), error


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_level_ground_does_not_tell_the_sign_of_the_pitch(tmp_path: Path, sign: float) -> None:
    assert run(tmp_path, mapping(), on_slopes(sign, 0.0)) == 0


def test_a_single_impossible_value_is_left_to_the_estimator(tmp_path: Path) -> None:
    lines = rows(20)
    lines[7] = lines[7].replace(",12,", ",12000,")
    assert run(tmp_path, mapping(), lines) == 0


def test_decimal_commas_and_words_for_missing_values(tmp_path: Path) -> None:
    lines = [line.replace(",", ";").replace(".", ",") for line in [HEADER, *ROWS]]
    lines[2] = lines[2].replace(";;", ";n/a;")
    assert run(tmp_path, mapping(delimiter=";", decimal=",", missing=["n/a", "-"]), lines) == 0
    first, second = messages(tmp_path / "bag", "/wheel_sinkage")
    assert first.sinkage[0] == 0.012
    assert math.isnan(second.sinkage[0])
    assert messages(tmp_path / "bag", "/imu")[0].linear_acceleration.x == pytest.approx(0.980665)


def test_the_rate_is_found_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path, mapping(), rows(100, 50.0)) == 0
    assert "100 rows at 50 Hz; replay averages them to 10 Hz" in capsys.readouterr().out
    (tmp_path / "bag").rename(tmp_path / "fast")
    assert run(tmp_path, mapping(), rows(20)) == 0
    assert "20 rows at 10 Hz\n" in capsys.readouterr().out
    assert run(tmp_path, mapping(), rows(20, 2.0)) == 2
    words = "column 't': the rows come at 2 Hz, but 5 to 200 Hz are needed: record faster"
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("unit", "per_unit", "words"),
    [
        ("s", 0.01, "0.01 Hz, but 5 to 200 Hz are needed: set time.unit: ms in the mapping"),
        ("us", 0.01, "1e+04 Hz, but 5 to 200 Hz are needed: set time.unit: ms in the mapping"),
        ("ns", 1e-5, "1e+04 Hz, but 5 to 200 Hz are needed: set time.unit: us in the mapping"),
    ],
)
def test_a_wrong_unit_of_time_is_named_with_the_one_that_fits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str, per_unit: float, words: str
) -> None:
    time = {"column": "t", "unit": unit}
    assert run(tmp_path, mapping(time=time), rows(20, per_unit)) == 2
    assert f"column 't': the rows come at {words}" in capsys.readouterr().err


def test_a_wheel_without_columns_is_not_measured_and_an_axle_without_any_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, mapping()) == 0
    assert "slip: no column for middle: without a whole axle every" in capsys.readouterr().out


def test_a_reader_who_wants_one_line_gets_it(tmp_path: Path) -> None:
    assert run(tmp_path, mapping(), rows(20)) == 0
    (tmp_path / "bag").rename(tmp_path / "other")
    command = (
        f"set -o pipefail; {sys.executable} -m terrain_estimator.cli.csv_to_bag {tmp_path}/data.csv"
        f" --mapping {tmp_path}/map.yaml --rover {tmp_path}/rover.yaml --out {tmp_path}/bag"
        " | (exec 0<&-)"
    )
    result = subprocess.run(["bash", "-c", command], check=False, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "bag" / "metadata.yaml").exists()
