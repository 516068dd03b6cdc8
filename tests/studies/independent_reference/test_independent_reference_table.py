# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of ``make independent-reference``, from drives with known distances."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from studies.independent_reference import __main__ as command
from studies.independent_reference.drives import Compared, Place
from studies.independent_reference.table import page, score


def compared(shift: float, ratio: float, again: float = math.nan) -> Compared:
    """Return a drive whose estimate is off by ``shift`` and ``ratio`` of the deviations.

    ``again`` is the shift of the repeated reference from the first one.
    """
    deviations = np.array([100.0, 0.01])
    middle = np.array([2000.0, 0.5])
    reference = np.array([[middle, deviations]] * 3)
    return Compared(
        truth=middle,
        estimated=np.array([middle + shift * deviations, ratio * deviations]),
        reference=reference,
        again=np.array([[middle + again * deviations, deviations]] * 3),
        distance=np.array([1.0, 3.0, 2.0, 1.0]),
        effective=np.array([200.0, 150.0, 150.0, 0.9]),
        refused=np.array(0.0),
        slip=np.array(0.3),
    )


def test_drives_count_whose_mean_and_deviation_are_within_the_target() -> None:
    drives = [compared(0.2, 1.1, 0.05), compared(-0.4, 1.1), compared(0.1, 0.7), compared(0.1, 1.3)]
    found = score(Place("mars_rover", "loose_sand", torque=True), drives)
    for each in found.readings[0]:
        assert (each.means, each.deviations) == (3, 2)
        assert each.shift == pytest.approx(0.0)
        assert each.largest == pytest.approx(0.4)
    assert found.joint == [1, 1, 1]
    assert found.distance == [1.0, 3.0, 2.0, 1.0]
    assert found.bias == [pytest.approx([0.0, 0.0], abs=0.2)] + [[0.0, 0.0]] * 3
    assert found.twice == 1
    assert found.moved == pytest.approx([0.05, 0.0])
    text = page([found], "Measured.", 7)
    assert "| v+L+M+B | flat | c | 3 of 4 | 2 of 4 | +0.00 ± 0.1" in text
    assert "| 2000 | 0.50 | 0.30 | +0.20 / +0.20 |" in text


def test_the_command_keeps_its_drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def compare(place: Place, drive: int, seed: int, *, twice: bool) -> Compared:
        calls.append((place.torque, drive, seed, twice))
        return compared(0.1, 1.0, 0.02 if twice else math.nan)

    monkeypatch.setattr(command, "compare", compare)
    out, table = tmp_path / "reference.json", tmp_path / "reference.md"
    call = ["--jobs", "1", "--drives", "3", "--twice", "1", "--seed", "3"]
    call += ["--records", str(tmp_path), "--out", str(out), "--table", str(table)]
    assert command.main(call) == 0
    assert calls == [
        (torque, k, 3, torque and k == 0) for torque in (True, False) for k in range(3)
    ]
    assert command.main(call) == 0
    assert len(calls) == 6
    assert [each["drives"] for each in json.loads(out.read_text())["scores"]] == [3, 3]
