# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sinkages from undisturbed ground of those that are measured in the tracks of wheels ahead.

The truth is a depth of each wheel by its place. What a sensor then reads, and where each track is,
is computed here by other means: by place along a straight line, by angle on a circle.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from terrain_estimator.estimator.saved_state import StateFileError
from terrain_estimator.estimator.wheel_tracks import LONGEST_GAP_S, WheelTracks
from terrain_estimator.observation import Floats, Observation
from terramechanics.presets import load_rover
from terramechanics.vehicle.wheel_places import WheelPlaces

PLANAR = load_rover("mars_rover")
FOUR = load_rover("four_wheel_rover")
TRACK_WIDTH = 0.4
PLACES = WheelPlaces.of(FOUR, TRACK_WIDTH)
STANDSTILL = 0.01  # [m/s]
DEVIATION = 0.0004  # [m]
SPEED = 0.1  # [m/s]
STEP_S = 0.1
LENGTH = PLANAR.axle_x[0] - PLANAR.axle_x[-1]
STRETCH = 0.25 * PLANAR.wheel_radius
Depth = Callable[[int, float], float]
"""Depth [m] of an axle in undisturbed ground at a place [m]."""


def waves(axle: int, place: float) -> float:
    """Return a depth: the middle axle is less deep than the front one in half of the places."""
    return 0.02 + 0.003 * math.sin(2.0 * place + 0.8 * axle) + 0.002 * (axle == 2)


def observed(
    local: Sequence[float],
    stamp_s: float,
    velocity: float = SPEED,
    *,
    rates: Sequence[float] | None = None,
    **fields: Any,
) -> Observation:
    """Return an observation whose wheels slip by a third, so that the body is slower."""
    size = len(local)
    rate = velocity / (1.0 - 1.0 / 3.0) / PLANAR.wheel_radius
    nothing = np.zeros(size)
    found = Observation(
        stamp_ns=round(1e9 * stamp_s),
        slip=nothing + 1.0 / 3.0,
        slip_sd=nothing + 0.01,
        sinkage=np.array(local, dtype=np.float64),
        sinkage_sd=nothing + DEVIATION,
        contact_angle=nothing,
        contact_angle_sd=nothing + 0.01,
        wheel_rate=nothing + rate if rates is None else np.array(rates),
        torque=nothing + 1.0,
        torque_sd=nothing + 0.1,
        velocity=velocity,
        velocity_sd=0.01,
        pitch=0.0,
        pitch_sd=0.01,
        acceleration=0.0,
        acceleration_sd=0.01,
        bogie_angle=0.0,
        lateral_velocity=0.0,
        lateral_velocity_sd=1e-6,
        yaw_rate=0.0,
        yaw_rate_sd=1e-6,
        local=True,
    )
    return dataclasses.replace(found, **fields)


def read(depth: Depth, gone: float) -> list[float]:
    """Return what sensors of three axles read after ``gone`` [m], with all of their way tracks."""
    found = []
    for axle, x in enumerate(PLANAR.axle_x):
        ahead = [depth(other, x + gone) for other in range(axle)]
        found.append(depth(axle, x + gone) - max(ahead, default=0.0))
    return found


def true(depth: Depth, gone: float) -> list[float]:
    return [depth(axle, x + gone) for axle, x in enumerate(PLANAR.axle_x)]


def planar() -> WheelTracks:
    return WheelTracks(PLANAR, None, STANDSTILL)


def drive(
    tracks: WheelTracks, seconds: float, start_s: float = 0.0, gone: float = 0.0
) -> tuple[list[Observation], list[list[float]], float]:
    """Drive straight at SPEED; return the observations, the truth and the way gone [m]."""
    found, truth = [], []
    for step in range(round(seconds / STEP_S)):
        at = gone + SPEED * STEP_S * step
        found.append(tracks.undisturbed(observed(read(waves, at), start_s + STEP_S * step)))
        truth.append(true(waves, at))
    return found, truth, gone + SPEED * STEP_S * round(seconds / STEP_S)


def sinkages(found: Sequence[Observation]) -> Floats:
    return np.array([each.sinkage for each in found])


def test_each_axle_is_as_deep_as_the_track_and_its_own_reading() -> None:
    found, truth, _ = drive(planar(), 40.0)
    depths = sinkages(found)
    known = np.isfinite(depths)
    # the depth of a stretch is its mean; the ground changes by at most 6 mm a metre
    np.testing.assert_allclose(depths[known], np.array(truth)[known], atol=0.006 * STRETCH)
    negative = np.array([read(waves, 0.01 * step)[1] < 0.0 for step in range(400)])
    assert negative.sum() > 100  # of which the middle axle rides above the track
    assert np.isfinite(depths[negative][100:]).all()
    assert not any(each.local for each in found)


def test_a_wheel_behind_is_unknown_until_it_is_where_the_front_wheels_began() -> None:
    tracks = planar()
    for step in range(200):
        gone = 0.01 * step
        found = tracks.undisturbed(observed(read(waves, gone), 0.1 * step))
        behind = [PLANAR.axle_x[0] - x for x in PLANAR.axle_x]
        if any(-1e-6 < gone - each < STRETCH + 1e-6 for each in behind[1:]):
            continue  # the stretch in which the wheel ahead was unknown
        expected = [False, *(each > gone for each in behind[1:])]
        assert np.isnan(found.sinkage).tolist() == expected, gone
        left = max(LENGTH - gone, 0.0)
        words, _, number = tracks.lacks.partition(": known in ")
        assert words == ("local sinkages need the tracks of the wheels ahead" if left > 0.0 else "")
        assert not words or float(number.removesuffix(" m")) == pytest.approx(left, abs=0.051)


def test_variances_add_up_along_a_track_and_count_for_each_wheel_that_follows() -> None:
    """An error of the front axle is that of three, one of the middle axle that of two."""
    found, _, _ = drive(planar(), 40.0)
    front, middle, rear = (found[-1].sinkage_sd / DEVIATION) ** 2
    assert front == pytest.approx(3.0, rel=1e-6)
    # the track is the deeper of two: where the middle axle rides above it, its error is not in it
    assert middle == pytest.approx(5.0, rel=1e-6)
    assert rear == pytest.approx(6.0, rel=1e-6) or rear == pytest.approx(4.0, rel=1e-6)


def test_the_way_is_that_of_the_body_not_of_the_wheels() -> None:
    """Tracks that were followed by the wheels' way would be 50 % too long, and a step be missed."""

    def stepped(_: int, place: float) -> float:
        return 0.02 + 0.01 * (place > 2.0)

    tracks = planar()
    found = [
        tracks.undisturbed(observed(read(stepped, 0.01 * step), 0.1 * step)) for step in range(450)
    ]
    truth = np.array([true(stepped, 0.01 * step) for step in range(450)])
    depths = sinkages(found)
    far = np.abs(np.array([[0.01 * step + x - 2.0 for x in PLANAR.axle_x] for step in range(450)]))
    clear = np.isfinite(depths) & (far > STRETCH)
    np.testing.assert_allclose(depths[clear], truth[clear], atol=1e-6)


def test_standing_keeps_the_tracks_whatever_the_velocity_says() -> None:
    tracks = planar()
    _, _, gone = drive(tracks, 30.0)
    standing = [0.0] * 3
    for step in range(600):
        noise = 0.02 * math.sin(0.01 * step)
        tracks.undisturbed(observed(read(waves, gone), 30.0 + 0.1 * step, noise, rates=standing))
    found, truth, _ = drive(tracks, 5.0, 90.0, gone)
    np.testing.assert_allclose(sinkages(found), truth, atol=0.006 * STRETCH)


@pytest.mark.parametrize(("gap_s", "known"), [(0.9, True), (1.2, False)])
def test_a_gap_is_bridged_up_to_a_second(gap_s: float, *, known: bool) -> None:
    assert 0.9 < LONGEST_GAP_S < 1.2
    tracks = planar()
    _, _, gone = drive(tracks, 30.0)
    at = gone + SPEED * (gap_s - STEP_S)
    found, truth, _ = drive(tracks, 5.0, 30.0 + gap_s - STEP_S, at)
    assert np.isfinite(sinkages(found)).all() == known
    assert np.isfinite(sinkages(found)[:, 0]).all()
    if known:
        np.testing.assert_allclose(sinkages(found), truth, atol=1e-3)
    else:
        assert np.isnan(sinkages(found)[:, 1:]).all()


@pytest.mark.parametrize("lost", [math.nan, 1e4])
def test_without_a_velocity_nothing_is_known_and_after_a_second_the_tracks_begin_anew(
    lost: float,
) -> None:
    tracks = planar()
    _, _, gone = drive(tracks, 30.0)
    nothing = tracks.undisturbed(observed(read(waves, gone), 30.0, lost))
    assert np.isnan(nothing.sinkage).all()
    assert "motion, which is not known" in tracks.lacks
    found, truth, gone = drive(tracks, 3.0, 30.1, gone + 0.01)
    np.testing.assert_allclose(sinkages(found), truth, atol=0.006 * STRETCH)
    for step in range(11):
        tracks.undisturbed(observed(read(waves, gone), 33.1 + STEP_S * step, lost))
    found, _, _ = drive(tracks, 3.0, 34.2, gone + 0.11)
    assert np.isnan(sinkages(found)[:, 1:]).all()


@pytest.mark.parametrize(
    "legs",
    [
        [*[0.3, -0.3] * 10, 3.0],
        [2.0, *[-0.05, 0.05] * 100, 3.0],
        [2.0, *[-0.3, 0.3] * 40, 3.0],
        [6.0, -3.5, 7.0],
    ],
    ids=["at the start", "a little, for long", "far, for long", "back a long way"],
)
def test_a_rover_that_rocks_is_never_taken_to_be_on_fresh_ground(legs: list[float]) -> None:
    """All wheels are 30 mm deep, and every place up to the front wheel has been rolled over."""
    depth, tracks, gone, farthest, stamp_s = 0.03, planar(), 0.0, 0.0, 0.0
    found = []
    for leg in legs:
        way = math.copysign(SPEED * STEP_S, leg)
        for _ in range(round(abs(leg) / (SPEED * STEP_S))):
            gone += way
            fresh = gone > farthest + 1e-9
            farthest = max(farthest, gone)
            reading = [depth if fresh and axle == 0 else 0.0 for axle in range(3)]
            rates = [math.copysign(1.0, leg)] * 3
            given = observed(reading, stamp_s, math.copysign(SPEED, leg), rates=rates)
            found.append(tracks.undisturbed(given))
            stamp_s += STEP_S
    depths = sinkages(found)
    error = np.abs(depths[np.isfinite(depths)] - depth)
    assert error.max() < 0.2 * depth  # over the end of a track a wheel is on both
    assert (error > 1e-9).mean() < 0.01
    assert np.isfinite(depths[-100:]).all()  # known again after the last leg


def test_a_wheel_that_was_not_measured_leaves_an_unknown_track() -> None:
    tracks = planar()
    _, _, gone = drive(tracks, 30.0)
    without = [
        tracks.undisturbed(
            observed([math.nan, *read(waves, gone + 0.01 * step)[1:]], 30.0 + 0.1 * step)
        )
        for step in range(20)
    ]
    assert np.isnan(sinkages(without)[:, 0]).all()
    assert np.isfinite(sinkages(without)[:, 1:]).all()
    found, truth, _ = drive(tracks, 20.0, 32.0, gone + 0.2)
    depths, places = sinkages(found), gone + 0.2 + 0.01 * np.arange(200)
    front = PLANAR.axle_x[0] + gone  # where the readings were missing, for 0.2 m
    for axle, x in enumerate(PLANAR.axle_x[1:], 1):
        within = (places + x > front + STRETCH) & (places + x < front + 0.2 - STRETCH)
        beyond = (places + x < front - STRETCH) | (places + x > front + 0.2 + STRETCH)
        assert within.any()
        assert np.isnan(depths[within, axle]).all()
        np.testing.assert_allclose(
            depths[beyond, axle], np.array(truth)[beyond, axle], atol=0.006 * STRETCH
        )


@pytest.mark.parametrize("bad", [math.inf, 1e9, -1.0, 1e300])
def test_an_impossible_reading_stays_impossible_and_makes_no_track(bad: float) -> None:
    tracks = planar()
    _, _, gone = drive(tracks, 30.0)
    spoilt = tracks.undisturbed(observed([bad, *read(waves, gone)[1:]], 30.0))
    assert abs(spoilt.sinkage[0]) >= 1.0
    assert spoilt.sinkage_sd[0] == DEVIATION
    found, truth, _ = drive(tracks, 30.0, 30.1, gone + 0.01)
    np.testing.assert_allclose(sinkages(found), truth, atol=0.006 * STRETCH)


@pytest.mark.parametrize("deviation", [0.0, -1.0, math.nan, math.inf, 1e300, -1e300])
def test_a_deviation_that_is_none_is_passed_on(deviation: float) -> None:
    tracks = planar()
    _, _, gone = drive(tracks, 30.0)
    wrong = dataclasses.replace(
        observed(read(waves, gone), 30.0), sinkage_sd=np.array([DEVIATION, deviation, DEVIATION])
    )
    assert tracks.undisturbed(wrong).sinkage_sd[1] == pytest.approx(deviation, nan_ok=True)


def test_undisturbed_sinkages_are_as_they_were_and_break_the_tracks() -> None:
    tracks = planar()
    plain = dataclasses.replace(observed(true(waves, 0.0), 0.0), local=False)
    assert tracks.undisturbed(plain) is plain
    assert tracks.arrays() == {}
    _, _, gone = drive(tracks, 30.0, 0.1)
    assert tracks.arrays()
    assert tracks.undisturbed(dataclasses.replace(plain, stamp_ns=30_100_000_000)).sinkage[2] > 0.0
    assert tracks.arrays() == {}
    found, _, _ = drive(tracks, 1.0, 30.2, gone)
    assert np.isnan(sinkages(found)[:, 1:]).all()


def test_an_observation_out_of_order_changes_nothing_and_a_clock_set_back_begins_anew() -> None:
    tracks = planar()
    _, _, gone = drive(tracks, 30.0)
    before = tracks.arrays()
    for late_s in (0.0, 0.1, 1.0):
        again = tracks.undisturbed(observed(read(waves, gone), 29.9 - late_s))
        assert np.isnan(again.sinkage).all()
        assert not again.local
    assert same(before, tracks.arrays())
    found, _, _ = drive(tracks, 2.0, 5.0, gone)
    assert np.isnan(sinkages(found)[:, 1:]).all()
    assert np.isfinite(sinkages(found)[:, 0]).all()


def test_axles_that_turn_leave_their_tracks() -> None:
    """Left and right are averaged: after a turn by more than 0.2 rad nothing is said."""
    tracks = planar()
    _, _, gone = drive(tracks, 30.0)
    turning = [
        tracks.undisturbed(observed(read(waves, gone), 30.0 + STEP_S * step, yaw_rate=0.05))
        for step in range(55)
    ]
    assert np.isfinite(sinkages(turning[:35])).all()
    assert np.isnan(sinkages(turning[45:])[:, 1:]).all()


def same(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> bool:
    return one.keys() == other.keys() and all(
        one[name].tobytes() == other[name].tobytes() for name in one
    )


def test_memory_is_constant() -> None:
    tracks = planar()
    _, _, gone = drive(tracks, 60.0)
    size = sum(each.nbytes for each in tracks.arrays().values())
    drive(tracks, 60.0, 60.0, gone)
    assert sum(each.nbytes for each in tracks.arrays().values()) == size
    assert size < 20_000


# ---------------------------------------------------------------- rovers that turn, by wheel

DEEP = {"front_left": 0.02, "front_right": 0.021, "rear_left": 0.025, "rear_right": 0.018}
WHEELS = PLACES.wheels(FOUR)
BOTTOM = np.array([DEEP[name] for name in WHEELS])
FRONT_X, REAR_X = FOUR.axle_x
WIDTH = FOUR.wheel_width


def by_wheel() -> WheelTracks:
    return WheelTracks(FOUR, PLACES, STANDSTILL)


class Rover:
    """A rover of four wheels whose readings are given: by default those of one in its tracks."""

    def __init__(self) -> None:
        self.tracks, self.stamp_s = by_wheel(), 0.0

    def go(
        self,
        seconds: float,
        along: float = SPEED,
        left: float = 0.0,
        turn: float = 0.0,
        *,
        reading: Sequence[float] | None = None,
        way: float = 1.0,
    ) -> list[Observation]:
        """Move, with the wheels turning as the left and the right side do."""
        in_tracks = [BOTTOM[0], BOTTOM[1], BOTTOM[2] - BOTTOM[0], BOTTOM[3] - BOTTOM[1]]
        given = in_tracks if reading is None else reading
        sides = [along - 0.5 * TRACK_WIDTH * turn, along + 0.5 * TRACK_WIDTH * turn]
        rates = [way * (side or SPEED) * 1.5 / FOUR.wheel_radius for side in [*sides, *sides]]
        found = []
        for _ in range(round(seconds / STEP_S)):
            moving = {"lateral_velocity": left, "yaw_rate": turn}
            observation = observed(given, self.stamp_s, along, rates=rates, **moving)
            found.append(self.tracks.undisturbed(observation))
            self.stamp_s += STEP_S
        return found


def test_straight_ahead_the_rear_wheels_run_in_the_tracks_of_their_side() -> None:
    found = Rover().go(12.0)
    np.testing.assert_allclose(found[-1].sinkage, BOTTOM, atol=1e-9)
    assert np.isnan(found[0].sinkage).tolist() == [False, False, True, True]


@pytest.mark.parametrize("part", [0.25, 0.5, 1.2])
def test_beside_a_track_its_depth_counts_by_the_part_of_the_wheel_in_it(part: float) -> None:
    """After a straight drive the rover moves aside at once, by a part of a wheel's width."""
    rover = Rover()
    rover.go(15.0)
    [moved] = rover.go(STEP_S, 0.0, 2.0 * part * WIDTH / STEP_S)[:1]  # half of it by the mean
    on = max(0.0, 1.0 - part)
    own = BOTTOM[2] - BOTTOM[0]
    assert moved.sinkage[2] == pytest.approx(own + on * BOTTOM[0], abs=1e-9)
    # the front wheel's error counts twice, as far as the track counts
    assert moved.sinkage_sd[2] == pytest.approx(DEVIATION * math.sqrt(1.0 + 2.0 * on**2), rel=1e-4)


def test_beside_a_track_that_is_not_known_a_wheel_is_on_fresh_ground() -> None:
    """The rover crabs to the left out of the place where it began; its left wheels lead."""
    rover = Rover()
    found = rover.go(10.0, 0.02, SPEED, reading=[0.02] * 4)
    assert np.isnan(found[0].sinkage[2:]).all()
    np.testing.assert_allclose(found[-1].sinkage[[0, 2]], 0.02, atol=1e-12)
    assert found[-1].sinkage_sd[2] == pytest.approx(DEVIATION, rel=1e-12)


def test_noise_of_the_odometry_to_the_side_counts_for_as_long_as_it_lasts() -> None:
    """It moves a wheel beside its track by a random walk, over the readings of a wheelbase."""
    tracks, side_sd = by_wheel(), 0.005
    reading = [BOTTOM[0], BOTTOM[1], BOTTOM[2] - BOTTOM[0], BOTTOM[3] - BOTTOM[1]]
    found = [
        tracks.undisturbed(observed(reading, STEP_S * step, lateral_velocity_sd=side_sd))
        for step in range(200)
    ][-1]
    np.testing.assert_allclose(found.sinkage, BOTTOM, atol=1e-9)
    np.testing.assert_allclose(found.sinkage_sd[:2], DEVIATION * math.sqrt(2.0), rtol=1e-9)
    readings = (FRONT_X - REAR_X) / (SPEED * STEP_S)  # since the front wheels were there
    walk = side_sd * STEP_S * math.sqrt(readings)
    expected = np.hypot(DEVIATION * math.sqrt(3.0), BOTTOM[:2] / WIDTH * walk * math.sqrt(readings))
    np.testing.assert_allclose(found.sinkage_sd[2:], expected, rtol=0.1)


def test_a_planar_rover_drives_straight_whatever_its_gyroscope_says() -> None:
    """Noise of the yaw rate, and of a lateral velocity, are in no sinkage of a model by axle."""
    plain, noisy = planar(), planar()
    for step in range(300):
        given = observed(read(waves, 0.01 * step), 0.1 * step)
        shaken = dataclasses.replace(
            given, yaw_rate=0.1 * (-1.0) ** step, yaw_rate_sd=0.1, lateral_velocity=0.02,
            lateral_velocity_sd=0.05,
        )  # fmt: skip
        one, other = plain.undisturbed(given), noisy.undisturbed(shaken)
        assert one.sinkage.tobytes() == other.sinkage.tobytes()
        assert one.sinkage_sd.tobytes() == other.sinkage_sd.tobytes()


def test_on_a_circle_rear_wheels_are_on_it_only_where_the_front_ones_were() -> None:
    """The middle of the circle is level with the rear axle: its wheels run on smaller circles.

    They are beside the front wheels' by the difference of the radii.
    """
    radius = 0.8
    turn = SPEED / radius
    # the body's origin is between the axles: the point that moves straight ahead is the rear axle
    left = -REAR_X * turn
    rover = Rover()
    found = rover.go(30.0, SPEED, left, turn, reading=[0.02, 0.02, 0.01, 0.01])
    length = FRONT_X - REAR_X
    for rear, side in ((2, 0.5 * TRACK_WIDTH), (3, -0.5 * TRACK_WIDTH)):
        inner = radius - side
        off = math.hypot(inner, length) - inner
        expected = 0.01 + max(0.0, 1.0 - off / WIDTH) * 0.02
        assert found[-1].sinkage[rear] == pytest.approx(expected, abs=2e-4)


def test_backing_over_own_tracks_counts_them_and_beyond_them_nothing_is_known() -> None:
    """The front wheels are in tracks of their own at first, then in those of the rear ones, too."""
    rover = Rover()
    rover.go(30.0)
    front, deepest = BOTTOM[:2], np.maximum(BOTTOM[:2], BOTTOM[2:])
    level = [0.0] * 4
    [turned] = rover.go(STEP_S, -SPEED, reading=level)
    assert np.isnan(turned.sinkage).all()  # on which side each measures is not known
    back = rover.go(3.0, -SPEED, reading=level)
    np.testing.assert_allclose(back[-1].sinkage, [*front, *deepest], atol=1e-9)
    back = rover.go(4.0, -SPEED, reading=level)
    np.testing.assert_allclose(back[-1].sinkage[:2], deepest, atol=1e-9)
    far = rover.go(20.0, -SPEED, reading=level)
    assert np.isnan(far[-1].sinkage[2:]).all()
    assert "they are not known here" in rover.tracks.lacks


def test_ahead_again_over_ground_that_was_backed_over() -> None:
    """The front wheels roll in their own tracks of before, until they are beyond them."""
    rover = Rover()
    rover.go(30.0)
    rover.go(2.5, -SPEED, reading=[0.0] * 4)
    again = rover.go(1.5, SPEED, reading=[0.0] * 4)
    assert again[-1].sinkage[0] == pytest.approx(BOTTOM[0], abs=1e-9)
    beyond = rover.go(3.0, SPEED, reading=[0.015, 0.015, 0.0, 0.0])
    assert beyond[-1].sinkage[0] == pytest.approx(0.015, abs=1e-9)


def test_on_the_spot_a_wheel_comes_into_the_track_of_the_next() -> None:
    """After 2 atan(b / l) the front right wheel is where the front left one began to turn."""
    rover = Rover()
    rover.go(30.0)
    quarter = 2.0 * math.atan2(0.5 * TRACK_WIDTH, FRONT_X)
    turn = 0.2
    reading = [0.03, 0.004, 0.03, 0.004]
    half = rover.go(0.4 * quarter / turn, 0.0, 0.0, turn, reading=reading)
    assert half[-1].sinkage[1] == pytest.approx(0.004, abs=1e-9)  # between: fresh
    rest = rover.go(0.75 * quarter / turn, 0.0, 0.0, turn, reading=reading)
    left = np.nanmax(sinkages(half)[:, 0])  # which began in the track of its straight drive
    assert 0.004 + BOTTOM[0] < rest[-1].sinkage[1] < 0.004 + left


@pytest.mark.parametrize("lost", ["lateral_velocity", "yaw_rate"])
def test_by_wheel_every_motion_is_needed(lost: str) -> None:
    tracks = by_wheel()
    unknown: dict[str, Any] = {lost: math.nan}
    missing = observed(BOTTOM.tolist(), 0.0, **unknown)
    assert np.isnan(tracks.undisturbed(missing).sinkage).all()
    planar_one = planar()
    planar_one.undisturbed(observed([0.02] * 3, 0.0, **unknown))
    assert planar_one.arrays()


# ---------------------------------------------------------------- saved state


@pytest.mark.parametrize("saved_after", [1, 2, 47, 250])
def test_restored_tracks_go_on_to_the_bit(saved_after: int) -> None:
    whole, restored = planar(), planar()
    for step in range(400):
        given = observed(read(waves, 0.01 * step), 0.1 * step)
        one = whole.undisturbed(given)
        if step < saved_after:
            continue
        if step == saved_after:
            restored.restore(whole.arrays())
            continue
        other = restored.undisturbed(given)
        assert one.sinkage.tobytes() == other.sinkage.tobytes()
        assert one.sinkage_sd.tobytes() == other.sinkage_sd.tobytes()
    assert same(whole.arrays(), restored.arrays())


def test_a_state_without_tracks_forgets_them() -> None:
    tracks = planar()
    drive(tracks, 30.0)
    tracks.restore({})
    assert tracks.arrays() == {}


CHANGES: dict[str, Callable[[dict[str, NDArray[Any]]], None]] = {
    "no trails": lambda each: each.__delitem__("tracks.trails"),
    "another rover's": lambda each: each.update({"tracks.trails": each["tracks.trails"][:, 4:]}),
    "single numbers": lambda each: each.update({"tracks.open": each["tracks.open"].astype("f4")}),
    "a place that is none": lambda each: each["tracks.trails"].__setitem__((0, 0), math.nan),
    "a place far away": lambda each: each["tracks.trails"].__setitem__((0, 0), 1e15),
    "a negative variance": lambda each: each["tracks.trails"].__setitem__((5, 10), -1.0),
    "a drift that falls": lambda each: each["tracks.trails"].__setitem__((5, 13), 1e3),
    "a velocity that is none": lambda each: each["tracks.numbers"].__setitem__(4, math.inf),
    "a negative way": lambda each: each["tracks.open"].__setitem__((0, 0), -1.0),
    "half a direction": lambda each: each["tracks.open"].__setitem__((5, 0), 0.5),
    "an old stamp": lambda each: each.update({"tracks.stamp": np.array(-5)}),
}


@pytest.mark.parametrize("change", CHANGES)
def test_tracks_that_no_drive_leaves_are_refused_and_nothing_changes(change: str) -> None:
    tracks = planar()
    drive(tracks, 30.0)
    before = tracks.arrays()
    changed = {name: np.array(each) for name, each in before.items()}
    CHANGES[change](changed)
    with pytest.raises(StateFileError, match="the state's tracks"):
        tracks.restore(changed)
    assert same(before, tracks.arrays())
