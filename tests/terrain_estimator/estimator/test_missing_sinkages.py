# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator without a sinkage sensor: what it takes, publishes, saves and refuses."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.discovery.runs import Refusals, RunError, run_of
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.messaging.averaging import Averager
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows, warm_up
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update
from tests.terrain_estimator.compiled.built_cores import needs_core
from tests.terrain_estimator.drives import drive_observations

WITHOUT = CoreConfig(use_sinkage=False)
SPENT = {"load", "moment", "bogie_moment"}


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture(scope="module")
def drive(model: LoadedModel) -> list[Observation]:
    """30 s in which no sinkage is measured."""
    seen = drive_observations(model.rover, model.metadata.soils[0], 30.0, seed=11)
    nothing = np.full(model.rover.axles, np.nan)
    return [dataclasses.replace(each, sinkage=nothing, sinkage_sd=nothing) for each in seen]


def test_it_estimates_the_ground_and_no_row_counts_as_missing(
    model: LoadedModel, drive: list[Observation]
) -> None:
    estimator = Estimator(model, WITHOUT)
    updates = [estimator.update(each) for each in drive]
    assert {each.decision.outcome for each in updates} == {Outcome.ACCEPTED}
    assert not SPENT & set(updates[-1].decision.rows_used)
    rows = usable_rows(model.rows, WITHOUT)
    assert not SPENT & set(rows)
    assert status_of(updates[-1], rows) is Status.CONVERGING
    assert "without sinkages nothing tells a drag" in updates[-1].unconfirmed
    soil, estimate = model.metadata.soils[0], updates[-1].estimate
    sd = np.sqrt(np.diagonal(estimate.covariance))
    assert (np.abs(estimate.mean - [soil.cohesion, soil.tan_phi]) < 3.0 * sd).all()


def test_a_sensor_that_is_switched_off_is_as_none(
    model: LoadedModel, drive: list[Observation]
) -> None:
    with_sensor = drive_observations(model.rover, model.metadata.soils[0], 30.0, seed=11)
    one, other = Estimator(model, WITHOUT), Estimator(model, WITHOUT)
    for measured, lacking in zip(with_sensor[:50], drive[:50], strict=True):
        same, expected = one.update(measured).estimate, other.update(lacking).estimate
        np.testing.assert_array_equal(same.mean, expected.mean)
        np.testing.assert_array_equal(same.covariance, expected.covariance)


def test_with_a_sensor_a_missing_sinkage_is_a_missing_row(
    model: LoadedModel, drive: list[Observation]
) -> None:
    estimator = Estimator(model, CoreConfig())
    last = [estimator.update(each) for each in drive[:50]][-1]
    rows = usable_rows(model.rows, CoreConfig())
    assert set(rows) - set(last.decision.rows_used) == SPENT
    assert status_of(last, rows) is Status.DEGRADED


def test_a_saved_state_goes_on_with_the_same_bytes(
    model: LoadedModel, drive: list[Observation]
) -> None:
    whole, half = Estimator(model, WITHOUT), Estimator(model, WITHOUT)
    for each in drive[:95]:
        whole.update(each)
        half.update(each)
    after = Estimator(model, WITHOUT)
    after.restore(half.save())
    for each in drive[95:140]:
        expected, found = whole.update(each), after.update(each)
        np.testing.assert_array_equal(found.estimate.covariance, expected.estimate.covariance)


@pytest.mark.parametrize("axles", [(1,), (0, 1, 2)])
def test_a_missing_wheel_rate_leaves_no_torque_on_the_ground_and_is_refused(
    model: LoadedModel, drive: list[Observation], axles: tuple[int, ...]
) -> None:
    """A block that holds such an observation could not be restored."""
    estimator, after = Estimator(model, WITHOUT), Estimator(model, WITHOUT)
    outcomes = []
    for k, each in enumerate(drive[:26]):
        rates = each.wheel_rate.copy()
        rates[list(axles) if k == 23 else []] = np.nan
        update = estimator.update(dataclasses.replace(each, wheel_rate=rates))
        outcomes.append(update.decision.outcome)
        if k == 23:
            assert "a wheel rate, too" in update.decision.detail
    assert [k for k, outcome in enumerate(outcomes) if not outcome.used] == [23]
    assert outcomes[23] is Outcome.NOT_FINITE
    after.restore(estimator.save())
    np.testing.assert_array_equal(
        after.update(drive[26]).estimate.mean, estimator.update(drive[26]).estimate.mean
    )


def test_a_bad_sensor_that_is_switched_off_costs_no_reading_of_a_mean(
    model: LoadedModel, drive: list[Observation]
) -> None:
    """50 Hz: each mean is of five readings, whatever the sensor says."""
    found = []
    for value in (np.nan, -0.05):
        averager, means = Averager(model.rover, WITHOUT), []
        for k, each in enumerate(drive[:60]):
            stamp, bad = (k + 1) * 20_000_000, np.full(3, value)
            reading = dataclasses.replace(each, stamp_ns=stamp, sinkage=bad, sinkage_sd=abs(bad))
            means += averager.add(Conversion(stamp, reading))
        found.append([each.notes for each in means if each.notes])
        last = means[-1].observation
        assert last is not None
        assert np.isnan(last.sinkage).all()
    assert found[0] == found[1]
    assert found[0][-1] == ("mean of 5 readings at 50 Hz",)


def test_the_warm_up_takes_every_observation_with_and_without_a_sensor(
    model: LoadedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    for core in (CoreConfig(), WITHOUT):
        outcomes: list[Outcome] = []
        update = Estimator.update

        def noted(self: Estimator, each: Observation, update: Any = update) -> Update:
            answer: Update = update(self, each)
            outcomes.append(answer.decision.outcome)  # noqa: B023
            return answer

        monkeypatch.setattr(Estimator, "update", noted)
        warm_up(model, EstimatorConfig(core=core))
        monkeypatch.undo()
        assert set(outcomes) == {Outcome.ACCEPTED}


@needs_core
def test_the_compiled_core_gives_what_torchscript_gives(
    model: LoadedModel, drive: list[Observation]
) -> None:
    core = load("", "compiled").model
    one, other = Estimator(model, WITHOUT), Estimator(core, WITHOUT)
    for each in drive:
        expected, found = one.update(each), other.update(each)
        sd = np.sqrt(np.diagonal(expected.estimate.covariance))
        assert (np.abs(found.estimate.mean - expected.estimate.mean) < 1e-9 * sd).all()


@pytest.mark.parametrize("off", ["use_torque", "use_moments"])
def test_too_few_sensors_are_refused_at_configure(off: str) -> None:
    with pytest.raises(ConfigError, match="use_sinkage: false needs use_torque and use_moments"):
        configure(CoreConfig, {"use_sinkage": False, off: False})


def test_a_model_that_needs_every_sinkage_is_refused_by_name(model: LoadedModel) -> None:
    effect = SimpleNamespace(name="drive_drag")
    needs = dataclasses.replace(model.metadata, effects=(effect,))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="needs every sinkage"):
        Estimator(dataclasses.replace(model, metadata=needs), WITHOUT)


def test_the_search_refuses_a_run_without_sinkages(
    model: LoadedModel, drive: list[Observation]
) -> None:
    with pytest.raises(RunError, match="axle 0: sinkage is nan"):
        run_of("run", drive[:20], model.rover, CoreConfig(), Refusals())
