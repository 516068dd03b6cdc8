# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of sensors: which rows they give, and drives without sinkages."""

import pytest
import torch

from studies import sensors
from studies.accuracy.scores import FROM_PRIOR, draw_drives
from studies.sensors import SETS, UNKNOWN, lacking_sinkage, mask
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.row_names import row_names
from terramechanics.presets import load_rover, load_soil


@pytest.mark.parametrize("axles", [2, 3])
def test_each_set_of_sensors_has_its_rows(axles: int) -> None:
    for each in SETS:
        kept = {
            name
            for name, there in zip(row_names(axles), mask(each, axles).tolist(), strict=True)
            if there
        }
        assert {"velocity", "load"} <= kept
        assert "acceleration" not in kept
        assert ("torque_1" in kept) == each.torque
        assert ("moment" in kept) == each.moments
        assert ("bogie_moment" in kept) == (each.moments and axles == 3)


def test_a_drive_without_sinkages_lacks_these_alone_and_its_truth_has_unknown_ones() -> None:
    drives = draw_drives(
        load_rover("mars_rover"), load_soil("loose_sand"), "S1", 2, 0.0, 3, FROM_PRIOR,
        duration_s=2.0,
    )  # fmt: skip
    lacking = lacking_sinkage(drives, 3)
    missing = torch.isnan(lacking.tasks.measured) & ~torch.isnan(drives.tasks.measured)
    assert int(missing.sum()) == 2 * 20 * 6
    true, whole = view_of(lacking.tasks.true, 3), view_of(drives.tasks.true, 3)
    assert torch.equal(true.sinkage, whole.sinkage)
    assert torch.equal(true.sinkage_sd, UNKNOWN * whole.sinkage)


def test_the_command_prints_a_line_for_each_rover_and_set(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sensors, "ROVERS", ("four_wheel_rover",))
    monkeypatch.setattr(sensors, "TIMES_S", (8.0,))
    assert sensors.main(["--drives", "3"]) == 0
    lines = capsys.readouterr().out.strip().splitlines()
    assert len(lines) == 2 + len(SETS)
    assert lines[2].startswith("| four_wheel_rover | sinkage, torque, moments |")
