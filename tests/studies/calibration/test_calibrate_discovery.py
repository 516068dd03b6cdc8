# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The calibration command, on cases that it finds in its file."""

import json
from pathlib import Path

import pytest

from studies.calibration.__main__ import main

CASES = [
    {
        "truth": "",
        "seed": 1,
        "with": {"named": [[[["payload", None]], -4.0]], "nothing_with": -20.0, "best_with": -24.0},
        "without": None,
    },
    {
        "truth": "payload",
        "seed": 1,
        "with": {
            "named": [[[["payload", None]], 90.0], [[["latency", None]], 9.0]],
            "nothing_with": 80.0,
            "best_with": 100.0,
        },
        "without": {"named": [[[["latency", None]], 9.0]], "nothing_with": 80.0, "best_with": 88.0},
    },
]


def test_thresholds_follow_from_the_cases_in_the_file_and_name_their_seeds(tmp_path: Path) -> None:
    samples, out = tmp_path / "samples.jsonl", tmp_path / "thresholds.json"
    samples.write_text("".join(json.dumps(case) + "\n" for case in CASES), encoding="utf-8")
    assert main(["--nulls", "0", "--cases", "0", "--samples", str(samples), "--out", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["anything"] == 8.0
    assert 9.0 / 88.0 < found["share"] < 0.9
    assert (found["seeds"], found["nulls"], found["effects"]) == ([1], 1, 1)


def test_a_file_that_cannot_be_written_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "samples.jsonl").write_text(json.dumps(CASES[0]) + "\n", encoding="utf-8")
    arguments = ["--nulls", "0", "--cases", "0", "--samples", str(tmp_path / "samples.jsonl")]
    assert main([*arguments, "--out", str(tmp_path / "missing" / "thresholds.json")]) == 2
    assert "thresholds.json" in capsys.readouterr().err
