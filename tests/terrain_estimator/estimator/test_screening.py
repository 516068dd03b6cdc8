# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The screening refuses what no model can take, masks single wheels, and lets noise pass."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.estimator.screening import Screening, screen
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP
from tests.rovers import MARS

RADIUS = MARS.wheel_radius
CONFIG = CoreConfig()
BAD = [math.nan, math.inf, -math.inf]
NOT_MEASURED = np.full(3, np.nan)
BOGIE, TORQUES = "the bogie's angle (use_moments)", "the torque of every wheel (use_torque)"


def observe(**changes: Any) -> Observation:
    """A rover that drives: three axles, all sensors."""
    good = Observation(
        stamp_ns=10**9,
        slip=np.array([0.2, 0.25, 0.3]),
        slip_sd=np.full(3, 0.01),
        sinkage=np.array([0.018, 0.019, 0.017]),
        sinkage_sd=np.full(3, 0.001),
        contact_angle=np.zeros(3),
        contact_angle_sd=np.full(3, 0.005),
        wheel_rate=np.full(3, 1.5),
        torque=np.full(3, 12.0),
        torque_sd=np.full(3, 0.4),
        velocity=0.15,
        velocity_sd=0.01,
        pitch=0.05,
        pitch_sd=0.005,
        acceleration=0.2,
        acceleration_sd=0.02,
    )
    return dataclasses.replace(good, **changes)


def verdict(previous_ns: int | None = None, /, **changes: Any) -> Screening:
    return screen(observe(**changes), previous_ns, MARS, CONFIG)


def at(axle: int, value: float, others: float) -> Any:
    """Three axles, one of which has its own value."""
    values = np.full(3, others)
    values[axle] = value
    return values


@pytest.mark.parametrize("angle", [math.inf, 30.0, -1.3])
def test_a_bogie_angle_that_no_bogie_has_is_masked_and_named(angle: float) -> None:
    result = verdict(bogie_angle=angle)
    assert result.outcome.used
    assert math.isnan(result.observation.bogie_angle)
    assert f"bogie angle {angle:g}" in result.detail


def test_a_good_observation_passes_unchanged() -> None:
    good = observe()
    result = screen(good, good.stamp_ns - 1, MARS, CONFIG)
    assert result.outcome is Outcome.ACCEPTED
    assert result.observation is good


def test_without_torque_imu_and_wheel_rates_it_is_still_accepted() -> None:
    bare = verdict(
        torque=NOT_MEASURED,
        torque_sd=NOT_MEASURED,
        wheel_rate=NOT_MEASURED,
        acceleration=math.nan,
        acceleration_sd=math.nan,
    )
    assert bare.outcome is Outcome.ACCEPTED


@pytest.mark.parametrize(
    ("rates", "velocity", "used"),
    [
        ([-1.5] * 3, -0.15, False),
        ([-1.5, 0.0, math.nan], -0.15, False),
        ([-1.5, -1.5, 0.5], -0.15, True),  # one axle rolls back, as on a step
        ([1.5] * 3, -0.15, True),  # it slides down
        ([math.nan] * 3, -0.15, False),
        ([math.nan] * 3, -0.03, True),  # within the noise of one that hardly moves
    ],
)
def test_a_rover_that_drives_backwards_is_refused(
    rates: list[float], velocity: float, *, used: bool
) -> None:
    result = verdict(wheel_rate=np.array(rates), velocity=velocity)
    assert result.outcome is (Outcome.ACCEPTED if used else Outcome.OUT_OF_RANGE)
    assert ("backwards" in result.detail) is not used


@pytest.mark.parametrize(
    ("previous_ns", "outcome"), [(10**9, Outcome.DUPLICATE), (10**9 + 1, Outcome.TIME_BACKWARDS)]
)
def test_a_stamp_that_does_not_increase_is_refused(previous_ns: int, outcome: Outcome) -> None:
    assert verdict(previous_ns).outcome is outcome


@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize("name", ["velocity", "pitch"])
def test_a_required_value_that_is_not_finite_is_named(name: str, value: float) -> None:
    result = verdict(**{name: value})
    assert result.outcome is Outcome.NOT_FINITE
    assert name in result.detail


@pytest.mark.parametrize("value", [*BAD, 0.0, -0.01])
@pytest.mark.parametrize("name", ["velocity", "pitch"])
def test_a_bad_deviation_of_a_required_value_is_named(name: str, value: float) -> None:
    result = verdict(**{f"{name}_sd": value})
    assert result.outcome is Outcome.BAD_DEVIATION
    assert name in result.detail


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("slip", value) for value in [*BAD, 1.0, 1.5, -1.1]),
        *(("sinkage", value) for value in [*BAD, -0.05, 0.0, RADIUS, 1.0]),
        *(("contact_angle", value) for value in [*BAD, 1.6]),
        *(("slip_sd", value) for value in [*BAD, 0.0, -1.0, 1e-160]),
        *(("sinkage_sd", value) for value in [*BAD, 0.0, -1.0]),
        *(("contact_angle_sd", value) for value in [*BAD, 0.0, -1.0]),
    ],
)
def test_an_observation_with_an_unusable_axle_is_refused_by_name(name: str, value: float) -> None:
    others = float(getattr(observe(), name)[0])
    expected = (
        Outcome.BAD_DEVIATION
        if name.endswith("_sd")
        else Outcome.OUT_OF_RANGE
        if math.isfinite(value)
        else Outcome.NOT_FINITE
    )
    for given in (at(1, value, others), np.full(3, value)):
        refused = verdict(**{name: given})
        assert refused.outcome is expected
        assert not refused.outcome.used
        assert "axle 1" in refused.detail


def test_without_any_sinkage_it_is_accepted_where_the_balances_tell_it() -> None:
    found = verdict(sinkage=NOT_MEASURED, sinkage_sd=NOT_MEASURED, bogie_angle=0.1)
    assert found.outcome is Outcome.ACCEPTED
    assert not found.detail


def test_one_missing_sinkage_takes_the_others_with_it_and_is_named() -> None:
    found = verdict(sinkage=at(1, math.nan, 0.018), bogie_angle=0.1)
    assert found.outcome is Outcome.ACCEPTED_PARTIALLY
    assert np.isnan(found.observation.sinkage).all()
    assert "axle 1: sinkage is nan" in found.detail
    again = screen(found.observation, None, MARS, CONFIG)
    assert again.outcome is Outcome.ACCEPTED


@pytest.mark.parametrize(
    ("changes", "needed"),
    [
        ({"bogie_angle": math.nan}, BOGIE),
        ({"bogie_angle": 4.0}, BOGIE),  # masked: no bogie turns so far
        ({"torque": NOT_MEASURED}, TORQUES),
        ({"torque": at(2, math.nan, 12.0)}, TORQUES),
        ({"torque_sd": at(2, math.nan, 0.4)}, TORQUES),
        ({"wheel_rate": at(0, 1e6, 1.5)}, TORQUES),  # masked with its rate
        ({"torque": NOT_MEASURED, "bogie_angle": math.nan}, f"{BOGIE} and {TORQUES}"),
    ],
)
def test_a_missing_sinkage_is_refused_where_what_replaces_it_is_not_measured(
    changes: dict[str, Any], needed: str
) -> None:
    found = verdict(**({"sinkage": at(1, math.nan, 0.018), "bogie_angle": 0.1} | changes))
    assert found.outcome is Outcome.NOT_FINITE
    assert found.detail == f"axle 1: sinkage is nan; to do without it, measure {needed}"


def test_a_missing_sinkage_is_refused_where_the_model_needs_it() -> None:
    seen = observe(sinkage=NOT_MEASURED, bogie_angle=0.1)
    found = screen(seen, None, MARS, CONFIG, sinkage_needed=True)
    assert found.outcome is Outcome.NOT_FINITE
    assert "axle 2: sinkage is nan" in found.detail


def test_a_sinkage_that_noise_makes_negative_is_told_from_a_sensor_error() -> None:
    noisy = verdict(sinkage=at(2, -0.0001, 0.018), sinkage_sd=np.full(3, 0.00006))
    broken = verdict(sinkage=at(2, -0.0003, 0.018), sinkage_sd=np.full(3, 0.00006))
    assert noisy.outcome is broken.outcome is Outcome.OUT_OF_RANGE
    assert "within its noise" in noisy.detail
    assert "sensor error" in broken.detail


def test_the_screening_refuses_only_what_no_model_can_take() -> None:
    """A threshold inside the range would cut the noise on one side only, and bias the mean."""
    draw = np.random.default_rng(1)
    true, sd = 0.00014, 0.00006
    kept = []
    for value in true + sd * draw.standard_normal(2000):
        result = verdict(sinkage=np.array([value, 0.018, 0.018]), sinkage_sd=np.full(3, sd))
        assert result.outcome.used == (value > 0.0)
        kept.append(value > 0.0)
    assert np.mean(kept) == pytest.approx(0.990, abs=0.01)


def test_standing_wheels_are_a_standstill_even_where_slip_is_undefined() -> None:
    assert (
        verdict(wheel_rate=np.full(3, 0.01), slip=np.full(3, np.nan), velocity=0.0).outcome
        is Outcome.STANDSTILL
    )


def test_a_stuck_rover_with_turning_wheels_does_not_stand() -> None:
    assert verdict(slip=np.full(3, 0.94), velocity=0.004).outcome is Outcome.ACCEPTED
    assert verdict(slip=np.full(3, 0.97), velocity=0.004).outcome is Outcome.OUT_OF_RANGE


def test_slip_is_bounded_where_the_model_ends_and_the_advice_says_where() -> None:
    assert (CONFIG.slip_minimum, CONFIG.slip_maximum) == (MIN_SLIP, MAX_SLIP)
    assert f"slip ({MIN_SLIP:g} to {MAX_SLIP:g})" in Outcome.OUT_OF_RANGE.advice
    for value in ({"slip_minimum": -0.7}, {"slip_maximum": 0.96}):
        with pytest.raises(ConfigError, match="outside its range"):
            configure(EstimatorConfig, value)


def test_without_wheel_rates_the_velocity_tells_a_standstill() -> None:
    assert verdict(wheel_rate=NOT_MEASURED, velocity=0.004).outcome is Outcome.STANDSTILL
    assert (
        verdict(wheel_rate=NOT_MEASURED, velocity=0.025, slip=NOT_MEASURED).outcome
        is Outcome.STANDSTILL
    )
    assert verdict(wheel_rate=NOT_MEASURED, velocity=0.025).outcome is Outcome.ACCEPTED


def test_an_optional_sensor_that_is_not_finite_is_masked_and_named() -> None:
    result = verdict(torque=at(0, math.inf, 12.0), acceleration=-math.inf)
    assert result.outcome is Outcome.ACCEPTED_PARTIALLY
    assert math.isnan(result.observation.torque[0])
    assert math.isnan(result.observation.acceleration)
    assert "torque" in result.detail
    assert "acceleration" in result.detail


def test_the_mean_sd_of_a_bad_optional_deviation_masks_it() -> None:
    result = verdict(torque_sd=at(2, 0.0, 0.4), acceleration_sd=-1.0)
    assert np.isnan(result.observation.torque).tolist() == [False, False, True]
    assert math.isnan(result.observation.acceleration)


def test_a_velocity_that_no_rover_has_is_refused_and_named() -> None:
    result = verdict(velocity=1e308)
    assert result.outcome is Outcome.OUT_OF_RANGE
    assert "velocity 1e+308 m/s is not within +-100" in result.detail


@pytest.mark.parametrize(
    ("changes", "masked", "words"),
    [
        ({"torque": at(1, -1e7, 12.0)}, ["torque"], "axle 1: torque -1e+07 N m"),
        ({"acceleration": 1e300}, ["acceleration"], "acceleration 1e+300 m/s^2"),
        (
            {"wheel_rate": at(1, 1e300, 1.5)},
            ["wheel_rate", "torque"],
            "axle 1: wheel rate 1e+300 rad/s",
        ),
        ({"torque_sd": at(1, 1e150, 0.4)}, ["torque"], "with standard deviation 1e+150"),
    ],
)
def test_what_no_sensor_can_measure_is_masked_and_named(
    changes: dict[str, Any], masked: list[str], words: str
) -> None:
    result = verdict(**changes)
    assert result.outcome is Outcome.ACCEPTED_PARTIALLY
    assert words in result.detail
    for name in masked:
        assert np.isnan(getattr(result.observation, name)).tolist() in ([False, True, False], True)
