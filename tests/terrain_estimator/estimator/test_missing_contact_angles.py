# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Contact angles that no sensor measures: what is supposed, and what is refused."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.discovery.runs import RunError
from terrain_estimator.estimator.configured import as_configured
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.messaging.averaging import Averager
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.offline.bag_options import BagOptions
from terrain_estimator.offline.reading_runs import read_run
from terrain_estimator.outcome import Outcome
from tests.rovers import MARS
from tests.terrain_estimator.drives import drive_observations

SUPPOSED = CoreConfig(contact_angle_sd=0.03)
NOTHING = np.full(3, np.nan)
SAMPLE = Path(__file__).parents[3] / "bags/sample"


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture(scope="module")
def measured(model: LoadedModel) -> list[Observation]:
    return drive_observations(model.rover, model.metadata.soils[0], 30.0, seed=11)


def without_angles(seen: Observation) -> Observation:
    return dataclasses.replace(seen, contact_angle=NOTHING, contact_angle_sd=NOTHING)


def test_they_are_along_the_body_and_along_the_bogie(measured: list[Observation]) -> None:
    seen = dataclasses.replace(without_angles(measured[0]), bogie_angle=0.2)
    found = as_configured(seen, MARS, SUPPOSED)
    np.testing.assert_array_equal(found.contact_angle, [0.0, 0.2, 0.2])
    np.testing.assert_array_equal(found.contact_angle_sd, [0.03] * 3)
    assert as_configured(seen, MARS, CoreConfig()) is seen


def test_the_bogies_angle_has_the_sign_of_the_ground(measured: list[Observation]) -> None:
    ground = [each.contact_angle[1:].mean() for each in measured]
    bogie = [each.bogie_angle for each in measured]
    assert np.corrcoef(ground, bogie)[0, 1] > 0.4


def test_a_measured_one_stays(measured: list[Observation]) -> None:
    seen = dataclasses.replace(measured[0], contact_angle=np.array([0.1, np.nan, -0.1]))
    found = as_configured(seen, MARS, SUPPOSED)
    np.testing.assert_array_equal(found.contact_angle[[0, 2]], [0.1, -0.1])
    np.testing.assert_array_equal(
        found.contact_angle_sd[[0, 2]], measured[0].contact_angle_sd[[0, 2]]
    )


def test_the_bogies_angle_is_used_where_its_moments_are_not(measured: list[Observation]) -> None:
    config = dataclasses.replace(SUPPOSED, use_moments=False)
    found = as_configured(without_angles(measured[20]), MARS, config)
    assert np.isnan(found.bogie_angle)
    assert found.contact_angle[1] == measured[20].bogie_angle


@pytest.mark.parametrize(
    ("config", "advice"),
    [(CoreConfig(), "set contact_angle_sd"), (SUPPOSED, "measure the bogie's angle, within")],
)
@pytest.mark.parametrize("bogie", [np.nan, 1.3, -4.0])
def test_what_is_lacking_is_named(
    model: LoadedModel,
    measured: list[Observation],
    config: CoreConfig,
    advice: str,
    bogie: float,
) -> None:
    seen = dataclasses.replace(without_angles(measured[0]), bogie_angle=bogie)
    decision = Estimator(model, config).update(seen).decision
    assert decision.outcome is Outcome.NOT_FINITE
    assert "axle 1: contact angle is nan" in decision.detail
    assert f"; without contact angles, {advice}" in decision.detail


@pytest.mark.parametrize("use_sinkage", [True, False])
def test_it_estimates_the_ground(
    model: LoadedModel, measured: list[Observation], *, use_sinkage: bool
) -> None:
    estimator = Estimator(model, dataclasses.replace(SUPPOSED, use_sinkage=use_sinkage))
    updates = [estimator.update(without_angles(each)) for each in measured]
    assert {each.decision.outcome for each in updates} == {Outcome.ACCEPTED}
    soil, first, last = model.metadata.soils[0], updates[0].estimate, updates[-1].estimate
    sd = np.sqrt(np.diagonal(last.covariance))
    assert (sd < 0.5 * np.sqrt(np.diagonal(first.covariance))).all()
    assert (np.abs(last.mean - [soil.cohesion, soil.tan_phi]) < 3.0 * sd).all()


@pytest.mark.parametrize("use_moments", [True, False])
def test_what_is_supposed_is_no_better_for_the_mean_of_many(
    measured: list[Observation], *, use_moments: bool
) -> None:
    config = dataclasses.replace(SUPPOSED, use_moments=use_moments)
    averager, means = Averager(MARS, config), []
    for count, each in enumerate(measured[:60], 1):
        seen = dataclasses.replace(without_angles(each), stamp_ns=count * 20_000_000)
        means += averager.add(Conversion(seen.stamp_ns, seen))
    last = means[-1].observation
    assert last is not None
    assert np.isfinite(last.slip).all()
    assert last.slip_sd[0] < 0.6 * measured[0].slip_sd[0]  # a mean
    found = as_configured(last, MARS, config)
    assert found.contact_angle[1] == last.bogie_angle != 0.0
    np.testing.assert_array_equal(found.contact_angle_sd, [0.03] * 3)


def test_the_search_refuses_the_parameter() -> None:
    options = BagOptions(config=EstimatorConfig(core=SUPPOSED))
    with pytest.raises(RunError, match="contact_angle_sd: the search needs every contact angle"):
        read_run(SAMPLE, MARS, options)


@pytest.mark.parametrize("value", [-0.01, 0.6, float("nan")])
def test_an_impossible_deviation_is_refused(value: float) -> None:
    with pytest.raises(ConfigError, match="contact_angle_sd"):
        configure(CoreConfig, {"contact_angle_sd": value})
