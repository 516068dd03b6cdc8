# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Counts tell what entered the posterior; a model that does not fit gives no estimate."""

import dataclasses
import itertools
import math
import re

import numpy as np
import pytest

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.intake import (
    FEWEST,
    LEAST_TAKEN,
    LONELY,
    WINDOW,
    Intake,
    mostly_refused,
)
from terrain_estimator.estimator.persistence import FEWEST as FEWEST_CHANGES
from terrain_estimator.estimator.persistence import Persistence
from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.learning.observing import STEP_NS
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Seconds, Update
from tests.terrain_estimator.drives import drive_observations

GOOD, WRONG = 100, 300
"""Observations whose torques are right, then those of another rover."""


def of_another_rover(observation: Observation) -> Observation:
    return dataclasses.replace(observation, torque=observation.torque + 50.0)


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture(scope="module")
def drive(model: LoadedModel) -> list[Observation]:
    right = drive_observations(model.rover, model.metadata.soils[0], 80.0, seed=11)
    wrong = slice(GOOD, GOOD + WRONG)
    right[wrong] = map(of_another_rover, right[wrong])
    return right


@pytest.fixture(scope="module")
def updates(model: LoadedModel, drive: list[Observation]) -> list[Update]:
    estimator = Estimator(model, CoreConfig())
    return [estimator.update(observation) for observation in drive]


def disagreeing(updates: list[Update]) -> list[Update]:
    return [each for each in updates if each.disagreements]


def test_what_was_left_out_is_never_counted_as_used(updates: list[Update]) -> None:
    last = updates[GOOD - 1].estimate
    assert (last.observations_used, last.observations_waiting) == (GOOD, 0)
    assert last.time_used_s == pytest.approx((GOOD - 1) * 0.1)
    for k, update in enumerate(updates[GOOD : GOOD + 100]):
        assert update.estimate.observations_used == GOOD
        assert update.estimate.time_used_s == last.time_used_s
        refused = k % 10 == 9
        assert update.decision.outcome is (Outcome.GATED if refused else Outcome.ACCEPTED)
        assert update.decision.settled == (9 if refused else 0)
        assert update.estimate.observations_waiting == (0 if refused else k % 10 + 1)
    assert "this observation and 9 before it" in updates[GOOD + 9].decision.detail
    assert updates[GOOD - 1].decision.settled == 10


def test_below_one_half_of_the_last_seconds_there_is_no_estimate(updates: list[Update]) -> None:
    """Ten seconds were taken, so the eleventh that is refused is one too many."""
    shares = [each.estimate.seconds for each in updates]
    for update, (judged, taken) in zip(updates, shares, strict=True):
        refused = [each for each in update.disagreements if "were taken" in each.finding]
        assert bool(refused) == (judged >= FEWEST and taken < 0.5 * judged)
    first = next(k for k, each in enumerate(updates) if each.disagreements)
    assert first == GOOD + 110 - 1
    assert shares[first] == (21, 10)
    for update in disagreeing(updates):
        estimate = update.estimate
        np.testing.assert_array_equal(estimate.mean, updates[0].estimate.mean)
        np.testing.assert_array_equal(estimate.covariance, updates[0].estimate.covariance)
        np.testing.assert_array_equal(estimate.upper_95, updates[0].estimate.upper_95)
        assert estimate.soil_probability == updates[0].estimate.soil_probability
        assert estimate.identified == (False, False)
        assert estimate.change_probability == 0.0
    [reason] = updates[first].disagreements
    assert reason.finding.startswith(
        "the model does not fit this rover or ground: 10 of the last 21"
    )
    assert reason.advice.startswith("check the model, the rover file")


@pytest.mark.parametrize(("of_three", "disagrees"), [(1, False), (2, True)])
def test_observations_that_are_refused_by_themselves_count_where_they_are_the_most(
    model: LoadedModel, of_three: int, *, disagrees: bool
) -> None:
    """They split the seconds: the few that were accepted between them are not what is judged."""
    drive = drive_observations(model.rover, model.metadata.soils[0], 16.0, seed=11)
    for k in range(GOOD, len(drive)):
        if k % 3 < of_three:
            drive[k] = dataclasses.replace(drive[k], velocity=2.0 * drive[k].velocity)
    estimator = Estimator(model, CoreConfig())
    updates = [estimator.update(each) for each in drive]
    refused = [each for each in updates if each.decision.outcome is Outcome.GATED]
    assert len(refused) == pytest.approx(of_three / 3 * (len(drive) - GOOD), abs=4)
    assert not any(each.decision.settled for each in refused), "each by itself"
    judged, taken = updates[-1].estimate.seconds
    assert judged >= FEWEST
    assert bool(updates[-1].disagreements) == (taken < LEAST_TAKEN * judged) == disagrees


@pytest.mark.parametrize(("of_ten", "confirmed"), [(0, True), (0.5, True), (2, False)])
def test_seconds_of_which_many_observations_were_refused_confirm_nothing(
    model: LoadedModel, of_ten: float, *, confirmed: bool
) -> None:
    """Wrong readings now and then are what the gate is for."""
    drive = drive_observations(model.rover, model.metadata.soils[0], 40.0, seed=11)
    spoilt = range(5, len(drive), round(10 / of_ten)) if of_ten else ()
    for k in spoilt:
        drive[k] = dataclasses.replace(drive[k], velocity=2.0 * drive[k].velocity)
    estimator = Estimator(model, CoreConfig())
    last = [estimator.update(each) for each in drive][-1]
    assert any(last.estimate.identified) == confirmed
    assert not last.disagreements
    words = "observations in the last .* seconds of driving were refused by themselves"
    assert bool(re.search(words, last.unconfirmed)) != confirmed


def test_a_pitch_of_the_wrong_sign_is_not_confirmed(model: LoadedModel) -> None:
    """Of 2400 observations over hills 718 would be IDENTIFIED if refused ones were not counted."""
    identified = {1.0: 0, -1.0: 0}
    for seed, sign in itertools.product(range(100, 104), identified):
        drive = drive_observations(model.rover, model.metadata.soils[0], 60.0, seed=seed)
        estimator = Estimator(model, CoreConfig())
        turned = [dataclasses.replace(each, pitch=sign * each.pitch) for each in drive]
        found = [any(estimator.update(each).estimate.identified) for each in turned]
        identified[sign] += sum(found)
    assert identified[1.0] > 1500
    assert identified[-1.0] < 24, "one of a hundred"


def test_ten_observations_refused_by_themselves_are_a_refused_second() -> None:
    intake = Intake()
    for _ in range(LONELY - 1):
        intake.leave_out()
    assert (intake.seconds, intake.alone) == (Seconds(0, 0), LONELY - 1)
    intake.leave_out()
    assert (intake.seconds, intake.alone) == (Seconds(1, 0), 0)
    for alone, taken in ((3, True), (4, False)):
        for _ in range(3):
            intake.wait(0.1)
        for _ in range(alone):
            intake.leave_out()
        before = intake.seconds
        assert intake.take() == 3
        assert intake.seconds == (before.judged + 1, before.taken + taken)


def test_a_return_to_the_prior_does_not_hide_a_misfit(updates: list[Update]) -> None:
    """After fifteen refused seconds the posterior starts anew; they still count."""
    words = "the prior holds again"
    anew = next(k for k, each in enumerate(updates) if words in each.decision.detail)
    assert updates[anew].estimate.observations_used == 0
    assert updates[anew].estimate.seconds == (25, 10)
    assert updates[anew].disagreements


def test_an_estimate_is_published_again_once_half_of_the_window_was_taken(
    updates: list[Update],
) -> None:
    back = updates[-1]
    assert back.estimate.seconds.judged == WINDOW
    assert not back.disagreements
    again = [k for k in range(GOOD + WRONG, len(updates)) if not updates[k].disagreements]
    assert again
    assert (
        np.diagonal(back.estimate.covariance) < 0.5 * np.diagonal(updates[0].estimate.covariance)
    ).all()
    assert back.estimate.observations_used >= 10 * (WINDOW // 2)


def test_then_the_velocity_stays_with_the_spread_of_its_last_changes(updates: list[Update]) -> None:
    found = disagreeing(updates)
    assert {each.decision.outcome for each in found} == {Outcome.ACCEPTED, Outcome.GATED}
    for update in found:
        assert update.prediction.valid, "on a refused second too"
        assert update.prediction.velocity == update.prediction.measured
    for one, other in itertools.pairwise(found):
        if other.sequence == one.sequence + 1:
            changed = other.prediction.measured - one.prediction.velocity
            assert other.prediction.innovation == changed
            assert other.prediction.innovation_variance == one.prediction.variance


def test_the_interval_of_a_velocity_that_stays_holds_what_it_says(
    model: LoadedModel, drive: list[Observation]
) -> None:
    """One drive of 80 s, 700 forecasts: 99.9 % of honest shares are within 92.3 to 97.7 %.

    Neighbours share a measurement, so the band is wider.
    """
    estimator = Estimator(model, CoreConfig())
    right = (drive[:GOOD], drive[GOOD + WRONG :])
    before, after = ([of_another_rover(each) for each in part] for part in right)
    wrong = [*before, *drive[GOOD : GOOD + WRONG], *after]
    made = [estimator.update(each).prediction for each in wrong]
    known = [each for each in made[100:] if math.isfinite(each.innovation_variance)]
    inside = [
        abs(each.innovation) < HALF_WIDTH_95 * math.sqrt(each.innovation_variance) for each in known
    ]
    assert len(known) > 600
    assert 0.915 < np.mean(inside) < 0.985


def test_a_saved_state_keeps_the_counts_and_the_judgement(
    model: LoadedModel, drive: list[Observation], updates: list[Update]
) -> None:
    estimator, other = Estimator(model, CoreConfig()), Estimator(model, CoreConfig())
    middle = GOOD + 154
    for observation in drive[:middle]:
        estimator.update(observation)
    other.restore(estimator.save())
    for observation, whole in zip(drive[middle:], updates[middle:], strict=True):
        restored = other.update(observation)
        assert repr(restored.prediction) == repr(whole.prediction)
        assert repr(restored.decision) == repr(whole.decision)
        assert restored.disagreements == whole.disagreements
        for one, same in (
            (restored.estimate.observations_used, whole.estimate.observations_used),
            (restored.estimate.time_used_s, whole.estimate.time_used_s),
            (restored.estimate.seconds, whole.estimate.seconds),
        ):
            assert one == same
        assert restored.estimate.mean.tobytes() == whole.estimate.mean.tobytes()


def test_a_users_reset_forgets_the_misfit(model: LoadedModel, drive: list[Observation]) -> None:
    estimator = Estimator(model, CoreConfig())
    refused = [estimator.update(observation) for observation in drive[GOOD : GOOD + 150]]
    assert refused[-1].disagreements
    estimator.reset()
    after = estimator.update(drive[0])
    assert not after.disagreements
    assert after.estimate.seconds == (0, 0)


def test_a_gap_ends_a_second_early_and_its_observations_count(
    model: LoadedModel, drive: list[Observation]
) -> None:
    later = [
        dataclasses.replace(each, stamp_ns=each.stamp_ns + 20 * STEP_NS) for each in drive[4:20]
    ]
    estimator = Estimator(model, CoreConfig())
    made = [estimator.update(observation) for observation in [*drive[:4], *later]]
    assert [each.decision.settled for each in made] == [0, 0, 0, 0, 4, *8 * [0], 10, *6 * [0]]
    assert [each.estimate.observations_waiting for each in made][3:6] == [4, 1, 2]
    assert made[4].estimate.observations_used == 4
    assert made[4].estimate.time_used_s == pytest.approx(0.3)
    assert made[-1].estimate.seconds == (2, 2)


@pytest.mark.parametrize(
    ("judged", "taken", "fits"),
    [(0, 0, True), (9, 0, True), (10, 5, True), (10, 4, False), (60, 30, True), (60, 29, False)],
)
def test_the_judgement_is_of_at_least_ten_seconds(judged: int, taken: int, fits: bool) -> None:  # noqa: FBT001
    assert (mostly_refused(Seconds(judged, taken)) == ()) is fits


def test_the_spread_is_the_mean_square_of_changes_within_one_step() -> None:
    """The changes are 0.01 and 0.03 m/s in turn: mean square 5e-4."""
    moving, velocity = Persistence(), 0.1
    for k in range(1000):
        velocity += 0.01 if k % 2 else -0.03
        moving = moving.observed(k * STEP_NS, velocity, one_step=k > 0)
        assert math.isnan(moving.forecast()[1]) == (k < FEWEST_CHANGES)
    mean, variance = moving.forecast()
    assert mean == velocity
    assert variance == pytest.approx(5e-4, rel=0.02)
    after_gap = moving.observed(2000 * STEP_NS, 5.0, one_step=False)
    assert after_gap.forecast() == (5.0, variance)
