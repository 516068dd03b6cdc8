# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The core from observation to update: accepted, refused, and never a number that is not one."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import torch

from rover_parameters.records import ConfigError
from studies.change.drives import Change, drive_over, places_of
from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.observing import STEP_NS, observations_of
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.torchscript import TorchScriptRuntime
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update
from terramechanics.presets import load_soil
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from tests.samples import sampled
from tests.terrain_estimator.drives import drive_observations


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture(scope="module")
def drive(model: LoadedModel) -> list[Observation]:
    return drive_observations(model.rover, model.metadata.soils[0], 30.0, seed=11)


def run(
    model: LoadedModel, observations: list[Observation], config: CoreConfig | None = None
) -> list[Update]:
    estimator = Estimator(model, config or CoreConfig())
    return [estimator.update(observation) for observation in observations]


def assert_publishable(update: Update) -> None:
    estimate = update.estimate
    assert np.isfinite(estimate.mean).all()
    assert (
        np.linalg.eigvalsh(
            estimate.covariance / np.outer(*2 * [np.sqrt(np.diagonal(estimate.covariance))])
        ).min()
        > 0.0
    )
    assert (estimate.lower_95 >= 0.0).all()
    if update.prediction.valid:
        assert math.isfinite(update.prediction.velocity)
        assert update.prediction.variance > 0.0


def test_a_drive_narrows_both_intervals_around_the_truth(
    model: LoadedModel, drive: list[Observation]
) -> None:
    """One drive, so the bound is wide: one in 16 000 honest estimates exceeds 4 deviations."""
    updates = run(model, drive)
    first, last = updates[0].estimate, updates[-1].estimate
    deviation = np.sqrt(np.diagonal(last.covariance))
    truth = np.array([model.metadata.soils[0].cohesion, model.metadata.soils[0].tan_phi])
    assert (np.abs(last.mean - truth) < 4.0 * deviation).all()
    assert (deviation < 0.5 * np.sqrt(np.diagonal(first.covariance))).all()
    assert {update.decision.outcome for update in updates} == {Outcome.ACCEPTED}
    assert last.observations_used == len(drive)
    assert last.time_used_s == pytest.approx((len(drive) - 1) * 0.1)


def test_the_estimate_starts_as_the_prior_and_is_not_called_identified(
    model: LoadedModel, drive: list[Observation]
) -> None:
    first = run(model, drive[:1])[0].estimate
    np.testing.assert_allclose(first.mean, model.metadata.prior_mean)
    np.testing.assert_allclose(np.sqrt(np.diagonal(first.covariance)), model.metadata.prior_sd)
    assert first.identified == (False, False)


def test_the_same_observations_give_the_same_bits(
    model: LoadedModel, drive: list[Observation]
) -> None:
    first, second = run(model, drive[:120]), run(model, drive[:120])
    assert [u.estimate.mean.tobytes() + u.estimate.covariance.tobytes() for u in first] == [
        u.estimate.mean.tobytes() + u.estimate.covariance.tobytes() for u in second
    ]
    np.testing.assert_array_equal(
        [u.prediction.velocity for u in first], [u.prediction.velocity for u in second]
    )


def test_reset_starts_over_but_counts_on(model: LoadedModel, drive: list[Observation]) -> None:
    estimator = Estimator(model, CoreConfig())
    before = [estimator.update(observation) for observation in drive[:60]]
    estimator.reset()
    after = [estimator.update(observation) for observation in drive[:60]]
    assert after[0].sequence == 60
    np.testing.assert_array_equal(before[-1].estimate.mean, after[-1].estimate.mean)


def test_a_block_whose_squared_distance_is_below_zero_is_a_numerical_failure(
    model: LoadedModel, drive: list[Observation], monkeypatch: pytest.MonkeyPatch
) -> None:
    estimator, of = Estimator(model, CoreConfig()), TorchScriptRuntime.report
    known = [estimator.update(observation) for observation in drive[:50]][-1]
    monkeypatch.setattr(
        TorchScriptRuntime, "report", lambda self, state: of(self, state)._replace(misfit=-2.0)
    )
    failed = estimator.update(drive[50])
    assert failed.decision.outcome is Outcome.NUMERICAL_FAILURE
    np.testing.assert_array_equal(failed.estimate.covariance, known.estimate.covariance)


BROKEN: dict[str, tuple[dict[str, object], set[Outcome]]] = {
    "velocity NaN": ({"velocity": math.nan}, {Outcome.NOT_FINITE}),
    "velocity infinite": ({"velocity": math.inf}, {Outcome.NOT_FINITE}),
    "velocity huge": ({"velocity": 1e308}, {Outcome.OUT_OF_RANGE}),
    "velocity impossible": ({"velocity": 30.0}, {Outcome.GATED}),
    "velocity certain": ({"velocity_sd": 0.0}, {Outcome.BAD_DEVIATION}),
    "deviation negative": ({"pitch_sd": -1.0}, {Outcome.BAD_DEVIATION}),
    "slip NaN": ({"slip": np.full(3, math.nan)}, {Outcome.NOT_FINITE}),
    "slip beyond one": ({"slip": np.full(3, 1.5)}, {Outcome.OUT_OF_RANGE}),
    "sinkage negative": ({"sinkage": np.full(3, -0.01)}, {Outcome.OUT_OF_RANGE}),
    "sinkage of one axle missing, and torque": (
        {"sinkage": np.array([0.01, math.nan, 0.01]), "torque": np.full(3, math.nan)},
        {Outcome.NOT_FINITE},
    ),
    "slip of one axle beyond the model": (
        {"slip": np.array([0.2, 0.2, 0.96])},
        {Outcome.OUT_OF_RANGE},
    ),
    "sinkage beyond the radius": ({"sinkage": np.full(3, 0.2)}, {Outcome.OUT_OF_RANGE}),
    "wheels standing": ({"wheel_rate": np.zeros(3)}, {Outcome.STANDSTILL}),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_observation_is_refused_and_costs_nothing_that_was_known(
    model: LoadedModel, drive: list[Observation], name: str
) -> None:
    changes, outcomes = BROKEN[name]
    estimator = Estimator(model, CoreConfig())
    before = [estimator.update(observation) for observation in drive[:100]][-1]
    refused = estimator.update(dataclasses.replace(drive[100], **changes))  # type: ignore[arg-type]
    assert refused.decision.outcome in outcomes
    assert refused.decision.detail
    assert not refused.prediction.valid
    assert_publishable(refused)
    np.testing.assert_array_equal(refused.estimate.mean, before.estimate.mean)
    after = [estimator.update(observation) for observation in drive[101:140]]
    assert after[-1].decision.outcome is Outcome.ACCEPTED
    assert_publishable(after[-1])


def test_nothing_is_foretold_until_an_acceleration_and_its_change_are_known(
    model: LoadedModel, drive: list[Observation]
) -> None:
    later = [
        dataclasses.replace(each, stamp_ns=each.stamp_ns + 20 * STEP_NS) for each in drive[60:]
    ]
    updates = run(model, [*drive[:60], *later])
    valid = [update.prediction.valid for update in updates]
    assert valid == [False, False, *[True] * 58, False, *[True] * (len(later) - 1)]
    first, second = updates[60].prediction, updates[61].prediction
    assert first.measured == later[0].velocity
    assert math.isnan(first.innovation)
    assert math.isnan(first.innovation_variance)
    assert math.isnan(second.innovation)
    assert math.isfinite(updates[62].prediction.innovation)


def test_an_innovation_is_that_of_the_time_that_was_foretold(
    model: LoadedModel, drive: list[Observation]
) -> None:
    updates = run(
        model, [*drive[:30], *drive[31:40]]
    )  # one is missing: the next is linked, but not what was foretold
    assert updates[30].prediction.valid
    assert math.isnan(updates[30].prediction.innovation)
    assert (
        updates[31].prediction.innovation
        == updates[31].prediction.measured - updates[30].prediction.velocity
    )


def test_updates_are_numbered_from_zero(model: LoadedModel, drive: list[Observation]) -> None:
    assert [update.sequence for update in run(model, drive[:3])] == [0, 1, 2]


def test_what_could_not_be_formed_is_answered_without_a_distance(model: LoadedModel) -> None:
    update = Estimator(model, CoreConfig()).reject(5, Outcome.NOT_FINITE, "slip is nan")
    decision = update.decision
    assert (update.stamp_ns, decision.outcome, decision.detail) == (
        5, Outcome.NOT_FINITE, "slip is nan",
    )  # fmt: skip
    assert (decision.rows_used, decision.degrees_of_freedom, decision.settled) == ((), 0, 0)
    assert math.isnan(decision.mahalanobis_squared)
    assert math.isnan(decision.threshold)


def test_a_pause_of_unknown_length_judges_no_forecast(
    model: LoadedModel, drive: list[Observation]
) -> None:
    judged, paused = Estimator(model, CoreConfig()), Estimator(model, CoreConfig())
    for observation in drive[:25]:
        judged.update(observation)
        paused.update(observation)
    paused.unlink()
    assert math.isfinite(judged.update(drive[25]).prediction.innovation)
    assert math.isnan(paused.update(drive[25]).prediction.innovation)


def test_an_answer_that_must_not_be_published_refuses_the_open_second(
    model: LoadedModel, drive: list[Observation], monkeypatch: pytest.MonkeyPatch
) -> None:
    estimator = Estimator(model, CoreConfig())
    for observation in drive[:23]:
        estimator.update(observation)
    name = "terrain_estimator.estimator.estimator.unsound_answer"
    monkeypatch.setattr(name, lambda *_: "a number is none")
    update = estimator.update(drive[23])
    assert update.decision.outcome is Outcome.NUMERICAL_FAILURE
    assert update.decision.settled == 4
    assert (update.estimate.observations_used, update.estimate.observations_waiting) == (0, 0)
    assert estimator.reopened == 1


def test_without_torque_and_imu_fewer_rows_are_used(
    model: LoadedModel, drive: list[Observation]
) -> None:
    full = run(model, drive)[-1]
    assert set(full.decision.rows_used) == set(model.rows)
    bare = run(model, drive, CoreConfig(use_torque=False, use_imu=False, use_moments=False))[-1]
    assert bare.decision.rows_used == ("velocity", "load")
    assert (np.diagonal(bare.estimate.covariance) > np.diagonal(full.estimate.covariance)).all()


def test_site_knowledge_replaces_the_prior(model: LoadedModel, drive: list[Observation]) -> None:
    config = CoreConfig(prior_cohesion_mean_pa=900.0, prior_cohesion_sd_pa=100.0)
    first = run(model, drive[:1], config)[0].estimate
    np.testing.assert_allclose(first.mean, [900.0, model.metadata.prior_mean[1]])
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(first.covariance)), [100.0, model.metadata.prior_sd[1]]
    )


@pytest.mark.parametrize(
    ("stamp_ns", "outcome"), [(0, Outcome.DUPLICATE), (-STEP_NS, Outcome.TIME_BACKWARDS)]
)
def test_an_old_stamp_is_refused(
    model: LoadedModel, drive: list[Observation], stamp_ns: int, outcome: Outcome
) -> None:
    estimator = Estimator(model, CoreConfig())
    estimator.update(drive[0])
    again = dataclasses.replace(drive[1], stamp_ns=drive[0].stamp_ns + stamp_ns)
    assert estimator.update(again).decision.outcome is outcome
    assert estimator.update(drive[1]).decision.outcome is Outcome.ACCEPTED


def test_torques_that_contradict_everything_are_left_out_second_by_second(
    model: LoadedModel, drive: list[Observation]
) -> None:
    wrong = [
        dataclasses.replace(observation, torque=observation.torque + 500.0)
        for observation in drive[100:160]
    ]
    estimator = Estimator(model, CoreConfig())
    before = [estimator.update(observation) for observation in drive[:100]][-1].estimate
    updates = [estimator.update(observation) for observation in wrong]
    gated = [update for update in updates if update.decision.outcome is Outcome.GATED]
    assert len(gated) >= 5
    assert gated[0].decision.mahalanobis_squared > gated[0].decision.threshold
    for update in updates:
        assert_publishable(update)
    doubted = updates[-1].estimate
    assert (np.diagonal(doubted.covariance) > np.diagonal(before.covariance)).all(), (
        "whether the ground or a sensor is to blame is not known"
    )
    after = [estimator.update(observation) for observation in drive[160:200]]
    assert after[-1].decision.outcome is Outcome.ACCEPTED
    deviation = np.sqrt(np.diagonal(before.covariance))
    assert (np.abs(after[-1].estimate.mean - before.mean) < 2.0 * deviation).all(), (
        "what was known is kept"
    )
    assert (np.sqrt(np.diagonal(after[-1].estimate.covariance)) < 1.05 * deviation).all()


def test_what_fits_no_ground_for_long_brings_the_prior_back(
    model: LoadedModel, drive: list[Observation]
) -> None:
    wrong = [
        dataclasses.replace(observation, torque=observation.torque + 500.0)
        for observation in drive[100:280]
    ]
    pipeline = Pipeline(model, EstimatorConfig())
    updates = [
        pipeline.answer(Conversion(observation.stamp_ns, observation)).update
        for observation in [*drive[:100], *wrong]
    ]
    last = updates[-1].estimate
    np.testing.assert_allclose(last.mean, model.metadata.prior_mean)
    assert last.identified == (False, False)
    assert (
        sum("the prior holds again" in update.decision.detail for update in updates)
        == pipeline.resets
        == 1
    )


def test_a_change_of_the_ground_is_told_and_followed(model: LoadedModel) -> None:
    """Drives from c 0.8 kPa, tan phi 0.5 to 2.5 kPa, 0.8 at one place.

    The truth may miss one interval of 4 deviations.
    """
    soil, count = model.metadata.soils[0], sampled(4, 8)
    weak, strong = (
        torch.tensor(values, dtype=torch.float64).expand(count, 2)
        for values in ((800.0, 0.5), (2500.0, 0.8))
    )
    generator = torch.Generator().manual_seed(7)
    ground = Ground(
        [
            Patch(soil.constants(), weak, name="weak"),
            Patch(soil.constants(), strong, start=5.0, name="strong"),
        ]
    )
    drives = simulate(model.rover, ground, "S1", 90.0, generator, count)
    measurement = measure_drive(model.rover, drives.sample, Noise(), generator)
    delays = []
    for index in range(count):
        first, last = (
            int((drives.sample.position[index] + reach < 5.0).sum()) for reach in (0.7, -0.7)
        )
        updates = run(model, observations_of(measurement, index)[: last + 200])
        changed = [
            k for k, update in enumerate(updates) if update.estimate.change_probability > 0.5
        ]
        assert changed
        assert changed[0] >= first, "no false alarm on the first ground"
        delays.append((changed[0] - first) * 0.1)
        estimate = updates[-1].estimate
        deviation = np.sqrt(np.diagonal(estimate.covariance))
        assert (np.abs(estimate.mean - [2500.0, 0.8]) < 4.0 * deviation).all()
        for update in updates:
            assert_publishable(update)
    assert np.median(delays) < 3.0, delays


@pytest.mark.parametrize("name", ["loose_sand", "compact_sand", "regolith"])
def test_the_soil_under_the_rover_is_found_among_those_that_the_model_knows(
    model: LoadedModel, name: str
) -> None:
    """One drive of 20 s: the true soil is not excluded, compact sand is told apart.

    Loose sand and regolith may look alike for that long.
    """
    soils = [soil.name for soil in model.metadata.soils]
    estimate = run(model, drive_observations(model.rover, load_soil(name), 20.0, seed=21))[
        -1
    ].estimate
    assert estimate.soils == tuple(soils)
    assert sum(estimate.soil_probability) == pytest.approx(1.0)
    assert estimate.soil_probability[soils.index(name)] > 0.01
    assert (estimate.soil_probability[soils.index("compact_sand")] > 0.99) == (
        name == "compact_sand"
    )


def test_the_condition_number_is_that_of_the_covariance_with_a_diagonal_of_one(
    model: LoadedModel, drive: list[Observation]
) -> None:
    update = run(model, drive[:100])[-1]
    deviation = np.sqrt(np.diagonal(update.estimate.covariance))
    low, high = np.linalg.eigvalsh(update.estimate.covariance / np.outer(deviation, deviation))
    assert high > 1.05, "c and tan phi are not correlated enough to test anything"
    assert update.condition_number == pytest.approx(high / low)


def test_an_observation_that_the_screening_refuses_has_no_distance(
    model: LoadedModel, drive: list[Observation]
) -> None:
    estimator = Estimator(model, CoreConfig())
    estimator.update(drive[1])
    decision = estimator.update(drive[0]).decision
    assert decision.outcome is Outcome.TIME_BACKWARDS
    assert decision.degrees_of_freedom == 0
    assert math.isnan(decision.mahalanobis_squared)
    assert math.isnan(decision.threshold)


def test_a_known_soil_is_the_only_one_that_is_considered(
    model: LoadedModel, drive: list[Observation]
) -> None:
    estimates = [
        update.estimate for update in run(model, drive[:100], CoreConfig(prior_soil="regolith"))
    ]
    for estimate in estimates:
        assert estimate.soil_probability == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)
    with pytest.raises(
        ConfigError,
        match=(
            r"prior\.soil: 'mud' is unknown to mars_rover-\d+: give loose_sand, compact_sand,"
            r" regolith"
        ),
    ):
        Estimator(model, CoreConfig(prior_soil="mud"))


def test_a_rover_that_reaches_compact_sand_finds_the_new_soil(model: LoadedModel) -> None:
    """Drives of the benchmark's change.

    Each that reported it has compact sand 10 s after all axles have reached it.
    """
    change, count = Change("mars_rover", "loose_sand", "compact_sand"), sampled(4, 6)
    generator = torch.Generator().manual_seed(5)
    drives = drive_over(model.rover, change, count, generator)
    measurement = measure_drive(model.rover, drives.sample, Noise(), generator)
    judged = 0
    for index in range(count):
        places = places_of(drives, index, change)
        if places is None:
            continue
        updates = run(model, observations_of(measurement, index)[: places[1] + 100])
        assert max(update.estimate.change_probability for update in updates[places[0] :]) > 0.5
        assert updates[-1].estimate.soil_probability[1] > 0.9
        judged += 1
    assert judged >= count / 2


def test_what_is_old_is_forgotten(model: LoadedModel, drive: list[Observation]) -> None:
    """The sooner, the wider the interval; by default never."""
    configs = [CoreConfig(forgetting_time=time_s) for time_s in (0.0, 1000.0, 100.0)]
    estimates = [run(model, drive[:200], config)[-1].estimate for config in configs]
    deviations = [np.sqrt(np.diagonal(each.covariance)) for each in estimates]
    assert (deviations[0] < deviations[1]).all()
    assert (deviations[1] < deviations[2]).all()


@pytest.mark.parametrize("time_s", [1e-3, 0.999])
def test_to_forget_within_less_than_a_second_is_refused(time_s: float) -> None:
    with pytest.raises(ConfigError, match=f"parameter forgetting_time: {time_s:g} s is less than"):
        CoreConfig(forgetting_time=time_s)
    assert CoreConfig(forgetting_time=4.0).drift == 0.5
    assert CoreConfig(forgetting_time=0.0).drift == 0.0


def test_random_hostile_numbers_never_give_a_covariance_that_is_none(
    model: LoadedModel, drive: list[Observation]
) -> None:
    """2000 observations, one in five with one field replaced at random; every update is checked."""
    generator = np.random.default_rng(7)
    hostile = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-300, 1e300, 1e308, 0.5)
    names = [field.name for field in dataclasses.fields(Observation) if field.name != "stamp_ns"]
    estimator, stamp = Estimator(model, CoreConfig()), 0
    used = 0
    for k in range(2000):
        observation = drive[k % len(drive)]
        if generator.random() < 0.2:
            name = names[generator.integers(len(names))]
            value = hostile[generator.integers(len(hostile))]
            changed: object = (
                np.full(3, value) if isinstance(getattr(observation, name), np.ndarray) else value
            )
            changes: dict[str, Any] = {name: changed}
            observation = dataclasses.replace(observation, **changes)
        stamp += STEP_NS
        update = estimator.update(dataclasses.replace(observation, stamp_ns=stamp))
        used += update.decision.outcome.used
        assert_publishable(update)
    assert used > 1000
