# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The drives that a training draws are those of the models that ship."""

import numpy as np
import pytest

from terrain_estimator.learning.generation import Chunk, Order, draw_chunk
from terramechanics.presets import load_rover, load_soil

TARGETS = {
    "mars_rover": [
        256.93510447070059, 17.819519330477053, 5158.8450527965069, 4728.6500649722357,
        7282.8493476676576, 1.7127541521274758, 0.38487327741155347,
    ],
    "paper_rover": [
        164.95459508081444, 21.049539480114838, 1080.7272815319927, 1295.7415686712288,
        1419.3084798026114, 0.33882131189122056, 0.18189236292006569,
    ],
}  # fmt: skip
"""Sums of the squares of each row's targets, when the models of version 15 were trained."""
CHANGED = (
    "the simulated drives have changed: the models that ship are no longer those of make train."
    " Train anew, raise VERSION in learning/export.py, and put these sums here (docs/training.md)"
)


@pytest.mark.parametrize("rover", TARGETS)
def test_a_training_draws_the_drives_that_the_shipped_models_were_trained_on(rover: str) -> None:
    """Another start of a step changes the sums by 1e-11, a processor without vectors by 1e-15."""
    order = Order(load_rover(rover), load_soil("loose_sand"), 20, 0, duration_s=20.0, share=0.4)
    drawn = draw_chunk(Chunk(order, 0, 20))
    sums = drawn.target.square().sum((0, 1)).numpy()
    np.testing.assert_allclose(sums, TARGETS[rover], rtol=1e-12, err_msg=CHANGED)
