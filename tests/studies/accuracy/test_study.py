# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The share of the learnt columns is that of the soil under the rover, up to a drive's end."""

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from studies.accuracy import cells as study
from studies.accuracy.scores import MeasuredDrives, draw_drives
from terrain_estimator.learning.restore import restore
from terrain_estimator.model.model_file import load_model


@pytest.fixture(scope="module")
def drives() -> MeasuredDrives:
    model = load_model("mars_rover")
    return draw_drives(model.rover, model.metadata.soils[1], "S1", 2, 0.0, seed=5)


def test_the_share_of_the_net_takes_the_soil_that_is_driven_on_and_stops_where_a_drive_ends(
    drives: MeasuredDrives,
) -> None:
    model = restore(load_model("mars_rover_with_net"))
    mean = torch.full((2, model.layout.first_constant + 12), 0.1, dtype=torch.float64)
    mean[:, :2] = drives.tasks.strength
    trace: Any = SimpleNamespace(final=mean)

    def share(ends: list[int], soil: int = 1) -> study.NetShare:
        cut = MeasuredDrives(drives.tasks, torch.tensor(ends), drives.constants)
        return study._share(model, soil, cut, trace, study.Setting("mars_rover", "compact_sand"))

    whole, short = share([400, 400]), share([400, 200])
    assert whole.velocity > 0.0
    assert share([400, 400], soil=0).velocity != whole.velocity
    assert short != whole
    drives.tasks.measured[1, 200:] = drives.tasks.measured[0, 200:]
    assert share([400, 200]) == short
    assert share([400, 400]) != whole
