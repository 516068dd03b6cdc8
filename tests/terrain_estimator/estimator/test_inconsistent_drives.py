# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives whose seconds are all taken though the model is wrong: they disagree; honest ones do not.

Drives are of one minute, with seeds that the limits were not chosen on.
"""

import dataclasses
from functools import cache

import numpy as np
import pytest

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.update import Update
from tests.samples import sampled
from tests.terrain_estimator.drives import drive_observations

DRIVES = sampled(2, 4)
DURATION_S = 60.0
_DEVIATIONS = ("slip_sd", "sinkage_sd", "contact_angle_sd", "torque_sd", "velocity_sd", "pitch_sd")


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


def drive(model: LoadedModel, seed: int) -> list[Observation]:
    return drive_observations(model.rover, model.metadata.soils[0], DURATION_S, 500 + seed)


def answered(model: LoadedModel, observations: list[Observation]) -> list[Update]:
    estimator = Estimator(model, CoreConfig())
    return [estimator.update(observation) for observation in observations]


def claimed(observation: Observation, factor: float) -> Observation:
    """Return the observation with ``factor`` times its standard deviations."""
    values = {name: factor * getattr(observation, name) for name in _DEVIATIONS}
    return dataclasses.replace(observation, **values)


@cache
def doubted(model: LoadedModel, seed: int) -> list[Update]:
    """Return the answers to a drive whose noise is twice what it states."""
    return answered(model, [claimed(each, 0.5) for each in drive(model, seed)])


def test_honest_drives_agree(model: LoadedModel) -> None:
    """`make test-long`: four minutes; one false alarm in an hour shows in one run of sixteen."""
    for seed in range(DRIVES):
        assert not any(each.disagreements for each in answered(model, drive(model, seed)))


def test_noise_of_twice_its_stated_deviation_disagrees(model: LoadedModel) -> None:
    """All four of four in `make test-long`: 47 % of such drives or more at a confidence of 95 %."""
    for seed in range(DRIVES):
        updates = doubted(model, seed)
        assert sum(updates[-1].estimate.seconds) > 0
        found = [each for each in updates if each.disagreements]
        assert found, f"drive {seed} agrees"
        first = found[0].disagreements[0]
        assert first.finding.startswith("the model does not fit this rover or ground: ")
        assert found[0].stamp_ns <= observations_s(40.0) + updates[0].stamp_ns
        np.testing.assert_allclose(found[0].estimate.mean, model.metadata.prior_mean, 1e-12)
        assert found[0].estimate.identified == (False, False)


def test_nothing_is_identified_until_the_fit_confirms_it(model: LoadedModel) -> None:
    """The data are enough for an honest rover after some seconds, the seconds judged are not."""
    updates = answered(model, drive(model, 0))
    sharp = [each.unconfirmed != "" or any(each.estimate.identified) for each in updates]
    confirmed = [any(each.estimate.identified) for each in updates]
    assert sharp.index(True) < 140 <= confirmed.index(True) < 200
    early = updates[sharp.index(True)]
    assert "judged from 15 seconds of driving" in early.unconfirmed
    assert early.estimate.identified == (False, False)
    assert np.mean(confirmed[200:]) > 0.8


def test_noise_that_is_too_large_is_unconfirmed_before_it_disagrees(model: LoadedModel) -> None:
    for seed in range(DRIVES):
        updates = doubted(model, seed)
        first = next(k for k, each in enumerate(updates) if each.disagreements)
        assert not any(any(each.estimate.identified) for each in updates[:first])
        assert updates[first].unconfirmed == ""  # the prior is published


def test_a_rover_that_states_too_much_noise_agrees(model: LoadedModel) -> None:
    updates = answered(model, [claimed(each, 2.0) for each in drive(model, 0)])
    assert not any(each.disagreements for each in updates)


def observations_s(seconds: float) -> int:
    return round(seconds * 1e9)


def test_a_restored_estimator_remembers_how_the_seconds_fitted(model: LoadedModel) -> None:
    observations = [claimed(each, 0.5) for each in drive(model, 0)]
    updates = doubted(model, 0)
    first = next(k for k, each in enumerate(updates) if each.disagreements)
    before, after = Estimator(model, CoreConfig()), Estimator(model, CoreConfig())
    for each in observations[: first - 3]:
        before.update(each)
    after.restore(before.save())
    again = [after.update(each).disagreements for each in observations[first - 3 : first + 50]]
    assert again == [each.disagreements for each in updates[first - 3 : first + 50]]
