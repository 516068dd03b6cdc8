# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The observations that are timed as closing a block do close one, also after a refused one."""

import dataclasses

import numpy as np
import pytest

from benchmarks.drives import observations
from benchmarks.observation import closing
from terrain_estimator.model.model_file import load_model


def test_a_refused_observation_moves_the_end_of_the_next_block() -> None:
    model = load_model()
    seen = observations(model, 3.0)
    assert np.flatnonzero(closing(model, seen)).tolist() == [9, 19, 29]
    seen[12] = dataclasses.replace(seen[12], velocity=np.nan)
    assert np.flatnonzero(closing(model, seen)).tolist() == [9, 20]
    with pytest.raises(
        ArithmeticError, match="none of 9 observations closes a block of the model mars_rover"
    ):
        closing(model, seen[:9])
