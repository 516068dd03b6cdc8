# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The gates reject the share of good observations that the user allows them."""

import dataclasses
import math
from functools import cache

import pytest
from scipy.stats import binom

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.model.model_file import load_model
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Decision
from tests.samples import sampled
from tests.terrain_estimator.drives import drive_observations

SEEDS = (100, 101, 102)
SECONDS = 30.0
CONFIDENCE = 0.999


@cache
def decisions(gate_probability: float) -> list[Decision]:
    model = load_model()
    found = []
    for seed in SEEDS:
        estimator = Estimator(model, CoreConfig(gate_probability=gate_probability))
        drive = drive_observations(model.rover, model.metadata.soils[0], SECONDS, seed)
        found += [estimator.update(observation).decision for observation in drive]
    return found


@pytest.mark.parametrize("probability", sampled([0.1], [0.1, 0.02]))
def test_the_gate_of_the_velocity_rejects_the_share_that_it_may(probability: float) -> None:
    """Three drives of 30 s, 900 observations: the count lies in the binomial's central 99.9 %.

    That holds if innovations are white and honest.
    """
    tested = [
        each
        for each in decisions(probability)
        if each.degrees_of_freedom == 1 and math.isfinite(each.mahalanobis_squared)
    ]
    rejected = [each for each in tested if each.outcome is Outcome.GATED]
    lowest, highest = binom.interval(CONFIDENCE, len(tested), probability)
    assert len(tested) > 850
    assert lowest <= len(rejected) <= highest
    assert all(
        (each.mahalanobis_squared > each.threshold) == (each.outcome is Outcome.GATED)
        for each in tested
    )


def test_the_gate_of_the_blocks_rejects_no_more_than_it_may() -> None:
    """90 blocks of those drives: the count is below the binomial's 99.9 % limit.

    A block is fitted before it is judged.
    """
    rejected = [
        each
        for each in decisions(0.1)
        if each.degrees_of_freedom > 1 and each.outcome is Outcome.GATED
    ]
    assert len(rejected) <= binom.ppf(CONFIDENCE, 90, 0.1)
    assert all(each.mahalanobis_squared > each.threshold for each in rejected)


def test_without_gates_nothing_is_gated() -> None:
    assert {each.outcome for each in decisions(0.0)} == {Outcome.ACCEPTED}
    assert all(math.isnan(each.threshold) for each in decisions(0.0)), (
        "an infinite one was published"
    )


def test_another_gate_holds_from_the_next_observation_on() -> None:
    model = load_model()
    estimator = Estimator(model, CoreConfig())
    drive = list(drive_observations(model.rover, model.metadata.soils[0], 3.0, SEEDS[0]))
    for observation in drive[:-2]:
        assert estimator.update(observation).decision.outcome is Outcome.ACCEPTED
    wrong = [dataclasses.replace(each, velocity=each.velocity + 1.0) for each in drive[-2:]]
    assert estimator.update(wrong[0]).decision.outcome is Outcome.GATED
    estimator.set_gate_probability(0.0)
    assert estimator.update(wrong[1]).decision.outcome is Outcome.ACCEPTED


def test_a_gate_that_is_set_later_is_the_one_of_the_parameter() -> None:
    model = load_model()
    later, given = (Estimator(model, CoreConfig(gate_probability=p)) for p in (0.3, 0.02))
    later.set_gate_probability(0.02)
    drive = drive_observations(model.rover, model.metadata.soils[0], 1.5, SEEDS[0])
    for observation in drive:
        found, right = (each.update(observation).decision.threshold for each in (later, given))
        assert found == right
        assert math.isfinite(right)
