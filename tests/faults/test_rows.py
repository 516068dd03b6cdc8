# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One row of each kind of the fault matrix, and its judge; `make faults` runs all rows."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from tests.faults.__main__ import FAULTS
from tests.faults.fault import Expected, Fault, Seen, complaints
from tests.faults.page import PAGE
from tests.samples import sampled

SHARE = sampled(
    ("backward jump", "kill -9 of the recorder"),
    ("1e308, optional", "backward jump", "SIGSTOP then SIGCONT", "kill -9 of the recorder"),
)
"""Rows of values, stamps, processes and recording whose result does not depend on duration."""
BEFORE_S, FAULT_S = 1, 2.0


@pytest.mark.parametrize(
    "fault", [fault for fault in FAULTS if fault.name in SHARE], ids=lambda fault: fault.name
)
def test_what_comes_of_a_fault_is_what_the_page_says(
    fault: Fault, tmp_path: Path, domain_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.faults.through.BEFORE_S", BEFORE_S)
    for module in ("values", "stamps"):
        monkeypatch.setattr(f"tests.faults.{module}.FAULT_S", FAULT_S)
    assert complaints(fault, fault.run(tmp_path, domain_id)) == []


AS_EXPECTED = Seen(
    {"GATED": 3}, {"refused": "ERROR"}, ("refused: 3 GATED",), 1, 0.1, 2, kept=True, well_again=True
)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"outcomes": {"GATED": 3, "ACCEPTED": 1}}, "outcomes"),
        ({"diagnostics": {}}, "diagnostics: expected"),
        ({"log": ()}, "nothing matches"),
        ({"log": ("refused: 3 GATED", "Traceback")}, "not expected: Traceback"),
        ({"back_after": 2}, "after it"),
        ({"lost": 3}, "lost"),
        ({"kept": False}, "kept"),
        ({"well_again": False}, "well again"),
        ({"unsound": ("cohesion is nan",)}, "cohesion is nan"),
    ],
)
def test_every_change_of_a_row_is_a_complaint(changes: dict[str, Any], words: str) -> None:
    expected = Expected(
        frozenset({"GATED"}),
        {"refused": "ERROR"},
        log=("^refused: [0-9]+ GATED",),
        back_after=1,
        lost=2,
    )

    def run(folder: Path, domain_id: int) -> Seen:
        raise NotImplementedError

    fault = Fault("a", "b", expected, run)
    assert complaints(fault, AS_EXPECTED) == []
    [complaint] = complaints(fault, dataclasses.replace(AS_EXPECTED, **changes))
    assert words in complaint


def test_the_page_has_every_row() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert [
        fault.name for fault in FAULTS if f"\n| {fault.name} | {fault.what} |" not in text
    ] == []
