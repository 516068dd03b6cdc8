# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The plants of the paper's experiments."""

import math

import pytest
import torch

from studies.paper.plants import TRAINING, Draw, PaperPlant, closed_form_motion, draw_drives
from terramechanics.presets import load_rover, load_soil

ROVER, SOIL = load_rover("paper_rover"), load_soil("loose_sand")


def test_training_grounds_leave_the_test_bands_out() -> None:
    batch = draw_drives(
        PaperPlant.CLOSED_FORM, ROVER, SOIL, TRAINING, 1.0, 300, torch.Generator().manual_seed(3)
    )
    cohesion, angle = (
        batch.drives.strength[:, 0],
        torch.rad2deg(torch.atan(batch.drives.strength[:, 1])),
    )
    assert not ((cohesion > 700.0) & (cohesion < 1300.0)).any()
    assert not ((angle > 20.0) & (angle < 45.0)).any()
    assert float(cohesion.min()) < 700.0
    assert float(cohesion.max()) > 4000.0
    assert float(angle.min()) < 10.0
    assert float(angle.max()) > 50.0
    # 0.2 of 3.9 kPa and 20 of 35 degrees lie below the gaps
    assert float((cohesion < 1000.0).double().mean()) == pytest.approx(0.2 / 3.9, abs=0.05)
    assert float((angle < 30.0).double().mean()) == pytest.approx(20.0 / 35.0, abs=0.1)


@pytest.mark.parametrize("plant", list(PaperPlant))
def test_the_same_seed_gives_the_same_drives(plant: PaperPlant) -> None:
    one, other = (
        draw_drives(plant, ROVER, SOIL, TRAINING, 2.0, 3, torch.Generator().manual_seed(4))
        for _ in range(2)
    )
    assert torch.equal(one.drives.velocity, other.drives.velocity)
    assert torch.equal(one.drives.slip, other.drives.slip)
    assert one.kept == other.kept


def test_the_closed_form_has_the_loads_and_sinkages_of_the_authors_stored_drive() -> None:
    """c 1 kPa, phi 30 degrees: sinkages 9.8, 10.4 and 4.9 mm; the loads add up to the weight."""
    strength = torch.tensor([[1000.0, math.tan(math.radians(30.0))]], dtype=torch.float64)
    motion = closed_form_motion(
        ROVER, SOIL.constants().expand(1, 6), strength, 40.0, torch.Generator().manual_seed(5)
    )
    assert motion.good.all()
    stored = torch.tensor([0.0098, 0.0104, 0.0049], dtype=torch.float64)
    assert float((motion.sinkage[0] / stored - 1.0).abs().max()) < 0.06
    assert float((motion.load.sum(-1) / ROVER.weight - 1.0).abs().max()) < 0.01
    assert float(motion.slip.min()) > 0.0
    assert float(motion.slip.max()) < 0.24


def test_ground_that_no_drive_survives_is_an_error_that_says_so() -> None:
    mud = Draw(((1.0, 2.0),), ((0.0, math.radians(0.1)),))
    with pytest.raises(ValueError, match="loose_sand, closed form plant: only 0 of"):
        draw_drives(
            PaperPlant.CLOSED_FORM, ROVER, SOIL, mud, 0.5, 1, torch.Generator().manual_seed(6)
        )
