# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator without a sinkage sensor: what it takes, publishes, saves and refuses."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.discovery.runs import Refusals, RunError, run_of
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
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


def test_it_identifies_the_ground_and_no_row_counts_as_missing(
    model: LoadedModel, drive: list[Observation]
) -> None:
    estimator = Estimator(model, WITHOUT)
    updates = [estimator.update(each) for each in drive]
    assert {each.decision.outcome for each in updates} == {Outcome.ACCEPTED}
    assert not SPENT & set(updates[-1].decision.rows_used)
    rows = usable_rows(model.rows, WITHOUT)
    assert not SPENT & set(rows)
    assert status_of(updates[-1], rows) is Status.IDENTIFIED
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


def test_the_compiled_core_gives_what_torchscript_gives(
    model: LoadedModel, drive: list[Observation]
) -> None:
    try:
        core = load("", "compiled").model
    except ConfigError as error:
        pytest.skip(str(error))
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
