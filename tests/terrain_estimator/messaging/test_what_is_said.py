# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Updates report what was done: the rows that entered, and the changes of the ground."""

import dataclasses

import numpy as np
import pytest

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from tests.terrain_estimator.drives import drive_observations


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture(scope="module")
def drive(model: LoadedModel) -> list[Observation]:
    return drive_observations(model.rover, model.metadata.soils[0], 6.2, seed=3)


def test_an_impossible_velocity_is_no_change_of_the_ground(
    model: LoadedModel, drive: list[Observation]
) -> None:
    """Try all ten observations of a block, since the last one closes the block."""
    estimator = Estimator(model, CoreConfig())
    for observation in drive[:50]:
        estimator.update(observation)
    known = estimator.update(drive[50])
    for observation in drive[51:61]:
        before = estimator.save()
        gated = estimator.update(
            dataclasses.replace(observation, velocity=observation.velocity + 10.0)
        )
        assert gated.decision.outcome is Outcome.GATED
        assert gated.estimate.change_probability == known.estimate.change_probability < 0.01
        estimator.restore(before)
        known = estimator.update(observation)


def test_a_torque_whose_wheel_rate_is_not_known_is_not_said_to_be_used(
    model: LoadedModel, drive: list[Observation]
) -> None:
    estimator, unknown = Estimator(model, CoreConfig()), np.full(3, np.nan)
    updates = [
        estimator.update(dataclasses.replace(observation, wheel_rate=unknown))
        for observation in drive[:20]
    ]
    said = [
        {row for row in update.decision.rows_used if row.startswith("torque")} for update in updates
    ]
    assert said == [
        {"torque_0", "torque_1", "torque_2"},
        *[set()] * 19,
    ], "the first has no rate before it that could have changed"
    only_once = estimator.update(
        dataclasses.replace(drive[20], wheel_rate=np.array([np.nan, 1.0, 1.0]))
    )
    assert "torque_1" not in only_once.decision.rows_used, "the rate before is not known"
    assert "torque_1" in estimator.update(drive[21]).decision.rows_used
