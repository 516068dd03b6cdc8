# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every limit of the screening: what lies at it, and the next number beyond it."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.moving import backwards
from terrain_estimator.estimator.screening import Screening, screen
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from tests.rovers import MARS
from tests.terrain_estimator.estimator.test_screening import observe

RADIUS, CONFIG = MARS.wheel_radius, CoreConfig()
STANDSTILL = CONFIG.standstill_speed
NAN = math.nan
WHEELS = ("slip", "slip_sd", "sinkage", "sinkage_sd", "contact_angle", "contact_angle_sd")


def verdict(previous_ns: int | None = None, /, **changes: Any) -> Screening:
    return screen(observe(**changes), previous_ns, MARS, CONFIG)


def up(value: float) -> float:
    return math.nextafter(value, math.inf)


def down(value: float) -> float:
    return math.nextafter(value, -math.inf)


def on_axle(name: str, axle: int, value: float) -> np.ndarray[Any, Any]:
    values: np.ndarray[Any, Any] = getattr(observe(), name).copy()
    values[axle] = value
    return values


INSIDE = {
    ("slip", CONFIG.slip_minimum): True,
    ("slip", down(CONFIG.slip_minimum)): False,
    ("slip", down(CONFIG.slip_maximum)): True,
    ("slip", CONFIG.slip_maximum): False,
    ("sinkage", up(0.0)): True,
    ("sinkage", 0.0): False,
    ("sinkage", down(RADIUS)): True,
    ("sinkage", RADIUS): False,
    ("contact_angle", down(math.pi / 2.0)): True,
    ("contact_angle", math.pi / 2.0): False,
    ("contact_angle", -down(math.pi / 2.0)): True,
    ("contact_angle", -math.pi / 2.0): False,
}


@pytest.mark.parametrize("axle", [0, 2])
@pytest.mark.parametrize(("name", "value"), INSIDE)
def test_a_wheel_is_refused_from_the_limit_of_the_model_on(
    name: str, value: float, axle: int
) -> None:
    found = verdict(**{name: on_axle(name, axle, value)})
    wanted = Outcome.ACCEPTED if INSIDE[name, value] else Outcome.OUT_OF_RANGE
    assert found.outcome is wanted
    assert (f"axle {axle}: " in found.detail) == (wanted is Outcome.OUT_OF_RANGE)


@pytest.mark.parametrize("name", WHEELS[1::2])
@pytest.mark.parametrize(
    ("value", "sound"), [(1e-9, True), (down(1e-9), False), (1e9, True), (up(1e9), False)]
)
def test_a_deviation_is_refused_where_its_square_is_not_safe(
    name: str,
    value: float,
    sound: bool,  # noqa: FBT001 # a case
) -> None:
    found = verdict(**{name: on_axle(name, 1, value)})
    assert found.outcome is (Outcome.ACCEPTED if sound else Outcome.BAD_DEVIATION)
    assert ("axle 1: the standard deviation of " in found.detail) == (not sound)


@pytest.mark.parametrize("name", ["velocity", "pitch"])
@pytest.mark.parametrize("value", [down(1e-9), up(1e9), NAN, -0.01, 0.0])
def test_a_required_sensor_needs_a_sound_deviation(name: str, value: float) -> None:
    found = verdict(**{f"{name}_sd": value})
    assert found.outcome is Outcome.BAD_DEVIATION
    assert name in found.detail


def test_the_worst_reason_of_several_wheels_is_that_of_the_range() -> None:
    both = {"slip": on_axle("slip", 0, NAN), "sinkage": on_axle("sinkage", 2, 0.5)}
    found = verdict(**both)
    assert found.outcome is Outcome.OUT_OF_RANGE
    assert "axle 0: slip is nan; axle 2: sinkage" in found.detail
    numbers = {"slip": on_axle("slip", 0, NAN), "slip_sd": on_axle("slip_sd", 1, 0.0)}
    assert verdict(**numbers).outcome is Outcome.NOT_FINITE


def test_a_sinkage_of_many_radii_is_taken_for_another_unit() -> None:
    assert ", in mm or cm?" in verdict(sinkage=on_axle("sinkage", 1, 18.0)).detail
    assert "in mm" not in verdict(sinkage=on_axle("sinkage", 1, 1.01 * RADIUS)).detail


@pytest.mark.parametrize(
    ("sinkage", "words"), [(-3.99e-3, "within its noise"), (-4.01e-3, "a sensor error")]
)
def test_noise_explains_four_deviations_below_the_surface(sinkage: float, words: str) -> None:
    assert words in verdict(sinkage=on_axle("sinkage", 1, sinkage)).detail


# time


@pytest.mark.parametrize(
    ("stamp_ns", "outcome"),
    [
        (10**9 - 1, Outcome.ACCEPTED),
        (10**9, Outcome.DUPLICATE),
        (10**9 + 1, Outcome.TIME_BACKWARDS),
    ],
)
def test_a_stamp_has_to_be_later_by_a_nanosecond(stamp_ns: int, outcome: Outcome) -> None:
    assert verdict(stamp_ns).outcome is outcome


def test_time_goes_before_everything_else() -> None:
    still = {"wheel_rate": np.zeros(3), "velocity": NAN}
    assert verdict(10**9, **still).outcome is Outcome.DUPLICATE
    assert verdict(None, **still).outcome is Outcome.STANDSTILL


# standing and driving backwards


def test_the_fastest_rim_tells_whether_a_rover_stands() -> None:
    at_limit = STANDSTILL / RADIUS
    rates = np.array([0.0, -at_limit * 0.999, 0.0])
    assert verdict(wheel_rate=rates).outcome is Outcome.STANDSTILL
    assert verdict(wheel_rate=np.array([0.0, at_limit * 1.001, NAN])).outcome is Outcome.ACCEPTED
    assert verdict(wheel_rate=np.array([0.0, -at_limit * 1.001, NAN])).outcome is (
        Outcome.OUT_OF_RANGE
    )
    assert verdict(wheel_rate=np.array([NAN, NAN, 0.0])).outcome is Outcome.STANDSTILL


@pytest.mark.parametrize(
    ("share", "outcome"), [(0.999, Outcome.STANDSTILL), (1.001, Outcome.ACCEPTED)]
)
def test_without_rates_and_slips_the_velocity_may_be_noise_of_three_deviations(
    share: float, outcome: Outcome
) -> None:
    """With a slip the wheels turn, so that the noise is left out."""
    unknown = {"wheel_rate": np.full(3, NAN), "velocity_sd": 0.004}
    slipping = verdict(velocity=share * STANDSTILL, **unknown)
    assert slipping.outcome is outcome
    bound = STANDSTILL + 3.0 * 0.004
    for sign in (1.0, -1.0):
        nothing = verdict(velocity=sign * share * bound, slip=np.full(3, NAN), **unknown)
        refused = nothing.outcome is Outcome.STANDSTILL
        assert refused == (outcome is Outcome.STANDSTILL)


def test_a_rover_drives_backwards_where_no_rim_goes_forward() -> None:
    def seen(**changes: Any) -> bool:
        return backwards(observe(**changes), RADIUS, 0.01)

    limit = 0.01 / RADIUS
    assert seen(wheel_rate=np.array([-1.0, -2.0, limit * 0.999]))
    assert not seen(wheel_rate=np.array([-1.0, -2.0, limit * 1.001]))
    assert not seen(wheel_rate=np.array([-1.0, NAN, 3.0]), velocity=-1.0)
    bare = np.full(3, NAN)
    assert seen(wheel_rate=bare, velocity=-(0.01 + 3.0 * 0.02) * 1.001, velocity_sd=0.02)
    assert not seen(wheel_rate=bare, velocity=-(0.01 + 3.0 * 0.02) * 0.999, velocity_sd=0.02)


# optional sensors

MASKED: dict[tuple[str, float], bool] = {
    ("bogie_angle", down(1.2)): False,
    ("bogie_angle", 1.2): True,
    ("bogie_angle", -1.2): True,
    ("bogie_angle", NAN): False,
    ("acceleration", 1e3): False,
    ("acceleration", up(1e3)): True,
    ("acceleration", -up(1e3)): True,
    ("acceleration", math.inf): True,
    ("acceleration_sd", down(1e-9)): True,
    ("acceleration_sd", 1e-9): False,
    ("acceleration_sd", NAN): True,
}


@pytest.mark.parametrize(("name", "value"), MASKED)
def test_an_optional_scalar_is_masked_beyond_its_limit(name: str, value: float) -> None:
    found = verdict(**{name: value})
    masked = MASKED[name, value]
    assert found.outcome is (Outcome.ACCEPTED_PARTIALLY if masked else Outcome.ACCEPTED)
    field = name.removesuffix("_sd")
    assert math.isnan(getattr(found.observation, field)) == (masked or math.isnan(value))
    for other in {"bogie_angle", "acceleration"} - {field}:
        expected = getattr(observe(), other)
        assert getattr(found.observation, other) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    ("value", "masked"), [(1e6, False), (up(1e6), True), (-up(1e6), True), (math.inf, True)]
)
def test_a_torque_that_no_motor_has_is_masked_on_its_axle(
    value: float,
    masked: bool,  # noqa: FBT001 # a case
) -> None:
    found = verdict(torque=on_axle("torque", 1, value))
    assert np.isnan(found.observation.torque).tolist() == [False, masked, False]
    assert ("axle 1: torque" in found.detail) == masked
    deviation = verdict(torque_sd=on_axle("torque_sd", 2, 0.0))
    assert np.isnan(deviation.observation.torque).tolist() == [False, False, True]


def test_a_rate_that_no_wheel_has_takes_the_torque_along() -> None:
    absurd = 100.0 / RADIUS
    fine = verdict(wheel_rate=on_axle("wheel_rate", 0, absurd * 0.999))
    assert fine.outcome is Outcome.ACCEPTED
    found = verdict(wheel_rate=on_axle("wheel_rate", 0, absurd * 1.001))
    assert found.outcome is Outcome.ACCEPTED_PARTIALLY
    assert np.isnan(found.observation.wheel_rate).tolist() == [True, False, False]
    assert np.isnan(found.observation.torque).tolist() == [True, False, False]
    both = verdict(
        wheel_rate=on_axle("wheel_rate", 0, absurd * 1.001), torque=on_axle("torque", 2, 1e9)
    )
    assert np.isnan(both.observation.torque).tolist() == [True, False, True]


@pytest.mark.parametrize(("speed", "outcome"), [(100.0, True), (up(100.0), False), (NAN, False)])
def test_a_velocity_is_taken_up_to_the_fastest(
    speed: float,
    outcome: bool,  # noqa: FBT001 # a case
) -> None:
    assert verdict(velocity=speed).outcome.used == outcome


@given(name=st.sampled_from(WHEELS), axle=st.integers(0, 2), value=st.floats(width=64))
def test_what_is_refused_is_handed_back_as_it_came(name: str, axle: int, value: float) -> None:
    observation: Observation = observe(**{name: on_axle(name, axle, value)})
    found = screen(observation, None, MARS, CONFIG)
    if not found.outcome.used:
        assert found.observation is observation
        assert f"axle {axle}" in found.detail
    else:
        for field in dataclasses.fields(Observation):
            np.testing.assert_array_equal(
                getattr(found.observation, field.name), getattr(observation, field.name)
            )


# planar motion

TURN, LEAN = CONFIG.turn_limit, CONFIG.roll_limit
RIM = 1.5 * RADIUS  # [m/s] of what observe() gives


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_lean_is_taken_up_to_its_limit(side: float) -> None:
    assert verdict(roll=side * LEAN).outcome is Outcome.ACCEPTED
    found = verdict(roll=side * up(LEAN))
    assert found.outcome is Outcome.NOT_PLANAR
    assert "3.4 deg" in found.detail


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("name", "arm"), [("lateral_velocity", 1.0), ("yaw_rate", max(MARS.axle_x))]
)
def test_an_axle_may_move_sideways_by_a_share_of_the_rims_speed(
    name: str, arm: float, side: float
) -> None:
    def moving(share: float, deviation: float) -> Screening:
        value = side * (share * TURN * RIM / arm + 2.0 * deviation)
        return verdict(**{name: value, f"{name}_sd": deviation})

    for deviation in (0.0, 0.01):
        assert moving(0.999, deviation).outcome is Outcome.ACCEPTED
        found = moving(1.001, deviation)
        assert found.outcome is Outcome.NOT_PLANAR
        assert name.replace("_", " ") in found.detail


def test_the_faster_of_rims_and_rover_counts() -> None:
    slow = {"lateral_velocity": 0.9 * TURN * 0.4, "lateral_velocity_sd": 0.0}
    assert verdict(**slow).outcome is Outcome.NOT_PLANAR
    assert verdict(velocity=0.4, **slow).outcome is Outcome.ACCEPTED


def test_the_axle_that_moves_most_counts() -> None:
    """Half of the limit by each motion together, at the front axle or at the rear one."""
    share = 0.6 * TURN * RIM
    for side in (1.0, -1.0):
        both = verdict(
            lateral_velocity=share,
            lateral_velocity_sd=0.0,
            yaw_rate=side * share / max(MARS.axle_x),
            yaw_rate_sd=0.0,
        )
        assert both.outcome is Outcome.NOT_PLANAR
    assert verdict(yaw_rate=share / max(MARS.axle_x), yaw_rate_sd=0.0).outcome.used


def test_an_encoder_that_went_mad_does_not_lift_the_limit() -> None:
    turning = {"yaw_rate": 0.5, "yaw_rate_sd": 0.003}
    assert verdict(**turning).outcome is Outcome.NOT_PLANAR
    mad = on_axle("wheel_rate", 2, 1e6)
    assert verdict(wheel_rate=mad, **turning).outcome is Outcome.NOT_PLANAR


def test_no_limit_and_no_measurement_let_every_motion_pass() -> None:
    wild = {
        "roll": 1.0,
        "lateral_velocity": 1.0,
        "lateral_velocity_sd": 0.0,
        "yaw_rate": 1.0,
        "yaw_rate_sd": 0.0,
    }
    free = dataclasses.replace(CONFIG, roll_limit=0.0, turn_limit=0.0)
    assert screen(observe(**wild), None, MARS, free).outcome is Outcome.ACCEPTED
    for name in ("roll", "lateral_velocity", "yaw_rate"):
        assert verdict(**{name: NAN}).outcome is Outcome.ACCEPTED
    for deviation in (NAN, -1.0):
        unknown = {"yaw_rate": 1.0, "yaw_rate_sd": deviation}
        assert verdict(**unknown).outcome is Outcome.ACCEPTED
