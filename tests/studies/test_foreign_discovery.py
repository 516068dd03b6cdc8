# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of the missing effect of foreign drives."""

from pathlib import Path

import pytest

from studies.foreign_discovery import __main__ as study
from studies.foreign_discovery import searched
from studies.foreign_discovery.searched import Searched, Signal, errors, groups
from studies.foreign_discovery.table import page

FOUND = Searched(
    "A_scm",
    "default",
    "named",
    "contact_law_scm 1.00 +- 0.05",
    ("cruise", "steep"),
    (800.0, 0.6),
    ((1600.0, 0.9), (1600.0, 0.9)),
    ((400.0, 0.66), (1000.0, 0.54)),
    (10.0, 4.0, 2.0),
    (0.75, 0.6, 0.9),
    (5.0, 2.0),
    (Signal("velocity", "m/s", 0.3, 0.1, 0.1), Signal("slip_0", "1", 0.1, 0.1, 0.2)),
    12.0,
)


def test_without_the_drives_it_says_where_they_come_from(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(searched, "log_names", list)
    out = ["--records", str(tmp_path), "--out", str(tmp_path / "o"), "--table", str(tmp_path / "t")]
    assert study.main(out) == 2
    assert "no drives in bags/foreign/logs" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_every_soil_and_law_of_the_drives_is_searched() -> None:
    assert groups() == [(soil, law) for soil in "AB" for law in ("radial", "scm", "tracks")]


def test_errors_are_medians_over_the_drives() -> None:
    before, after = errors(FOUND)
    assert before == pytest.approx((1.0, 0.5))
    assert after == pytest.approx((0.375, 0.1))


def test_the_page_has_names_and_gaps_by_signal() -> None:
    text = page([FOUND], "Measured.", 0)
    assert "| 75 % (60 to 90) |" in text
    assert "| A, scm | velocity | m/s | 0.3 | 0.1 | 0.1 | 100 % |" in text
    assert "| no gap |" in text
