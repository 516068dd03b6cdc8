# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Slip from wheel rates and a velocity, with its standard deviation."""

import math
from typing import Any

import numpy as np
import pytest

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from rover_sim_node.config import FOLLOW, SimulatorConfig
from rover_sim_node.messages import step_messages
from rover_sim_node.turning_run import TurningRun
from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.config.slip_source import SlipSourceConfig
from terrain_estimator.messaging.conversion import Converter
from terrain_estimator.messaging.slip_source import JOINTS, VELOCITY, SlipSource, SlipSourceError
from terrain_estimator.topics import Message
from terramechanics.description.layout import track_width_of
from terramechanics.presets import load_rover
from tests.drives import drive_messages

ROVER = load_rover("mars_rover")
RADIUS = ROVER.wheel_radius
TYPES = Types()
RATES = [1.0, 1.2, 0.9, 1.1, 0.8, 1.0]


def header(stamp_ns: int, frame: str = "") -> Message:
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return TYPES.make(
        "std_msgs/msg/Header",
        stamp=TYPES.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec),
        frame_id=frame,
    )


def joints(
    rates: list[float], stamp_ns: int = 0, names: tuple[str, ...] = ROVER.wheel_names
) -> Message:
    fields = {
        "name": ["rocker", *names],
        "velocity": np.array([0.0, *rates]),
        "position": np.zeros(0),
        "effort": np.zeros(0),
    }
    return TYPES.make("sensor_msgs/msg/JointState", header=header(stamp_ns), **fields)


def velocity(
    speed: float,
    variance: float,
    stamp_ns: int = 0,
    frame: str = "base_link",
    *,
    stamped: bool = False,
) -> Message:
    """Return an odometry, or a stamped twist, with its frame in the right field."""
    covariance = np.zeros(36)
    covariance[0] = variance
    twist = TYPES.make(
        "geometry_msgs/msg/Twist", linear=TYPES.make("geometry_msgs/msg/Vector3", x=speed)
    )
    both = TYPES.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance)
    if stamped:
        return TYPES.make(
            "geometry_msgs/msg/TwistWithCovarianceStamped",
            header=header(stamp_ns, frame),
            twist=both,
        )
    return TYPES.make(
        "nav_msgs/msg/Odometry", header=header(stamp_ns, "odom"), child_frame_id=frame, twist=both
    )


def published(
    rates: list[float], speed: float, variance: float = 1e-4, late_ns: int = 0, **values: Any
) -> list[Message]:
    frame = values.get("body_frame", "base_link")
    return published_of(rates, velocity(speed, variance, late_ns, frame), **values)


def published_of(rates: list[float], given: Message, **values: Any) -> list[Message]:
    source = SlipSource(ROVER, configure(SlipSourceConfig, values))
    pair = ((JOINTS, joints(rates)), (VELOCITY, given), (JOINTS, joints(rates, 10**9)))
    return [
        source.slip_message(found, TYPES.make)
        for topic, given in pair
        for found in source.pair(topic, given)
    ]


def axle_means(message: Message) -> tuple[list[float], list[float]]:
    """Return the estimator's mean and deviation of the slips of each axle."""
    others = {topic: given for topic, _, given in drive_messages(TYPES.make, 0.2)}
    convert = Converter(ROVER, ConversionConfig(), CoreConfig()).convert
    observation = convert(
        0, (message, others["wheel_sinkage"], others["odom"], None, None)
    ).observation
    assert observation is not None
    return observation.slip.tolist(), observation.slip_sd.tolist()


def test_the_deviation_of_an_axle_is_the_spread_of_its_mean_despite_common_errors() -> None:
    rates, speed, draws = np.array([1.2, 1.0, 1.1, 1.1, math.nan, 1.2]), 0.11, 20_000
    sds: dict[str, Any] = {"radius_deviation": 0.02, "rate_deviation": 0.03}
    (message,) = published(rates.tolist(), speed, 0.01**2, **sds)
    noise = np.random.default_rng(1)
    speeds, radii = (
        speed + 0.01 * noise.normal(size=(draws, 1)),
        RADIUS * (1.0 + 0.02 * noise.normal(size=(draws, 1))),
    )
    slips = 1.0 - speeds / (radii * (rates + 0.03 * noise.normal(size=(draws, 6))))
    means, deviations = axle_means(message)
    for axle, (mean, deviation) in enumerate(zip(means, deviations, strict=True)):
        drawn = np.nanmean(slips[:, np.array(ROVER.wheel_axle) == axle], axis=1)
        assert mean == pytest.approx(
            np.nanmean((1.0 - speed / (RADIUS * rates))[np.array(ROVER.wheel_axle) == axle])
        )
        assert deviation == pytest.approx(
            drawn.std(), rel=0.03
        )  # 20000 draws: within 2 % with 99.99 %


def test_a_sinkage_beside_the_slip_says_that_nothing_is_measured() -> None:
    slip = published(RATES, 0.1)[0]
    found = SlipSource(load_rover("mars_rover"), SlipSourceConfig()).sinkage_message(
        slip, Types().make
    )
    assert found.header == slip.header
    assert found.sequence == slip.sequence
    assert found.reference == "undisturbed"
    assert list(found.wheel) == list(slip.wheel)
    for name in ("sinkage", "sinkage_stddev", "contact_angle", "contact_angle_stddev"):
        assert np.isnan(getattr(found, name)).tolist() == [True] * 6


@pytest.mark.parametrize("stamped", [False, True])
def test_a_velocity_of_another_frame_is_refused_and_both_frames_are_named(*, stamped: bool) -> None:
    kind, field = ("twist", "header.frame_id") if stamped else ("odometry", "child_frame_id")
    for frame in ("camera", ""):
        given = velocity(0.1, 1e-4, frame=frame, stamped=stamped)
        with pytest.raises(
            SlipSourceError, match=rf"{field}.* is in frame '{frame}', expected 'base_link'"
        ):
            published_of(RATES, given, velocity_type=kind)
        (message,) = published_of(RATES, given, velocity_type=kind, body_frame="")
        assert message.header.frame_id == ConversionConfig().body_frame, (
            "the estimator refused a slip without a frame"
        )
    assert published_of(RATES, velocity(0.1, 1e-4, stamped=stamped), velocity_type=kind)


def test_every_wheel_has_its_slip_in_the_order_of_the_rover_file() -> None:
    (message,) = published(RATES, 0.1)
    assert tuple(message.wheel) == ROVER.wheel_names
    assert message.slip.tolist() == pytest.approx([1.0 - 0.1 / (RADIUS * rate) for rate in RATES])
    assert (message.slip_stddev > 0.0).all()


def test_in_a_turn_every_wheel_has_the_slip_of_its_own_speed() -> None:
    given, width, yaw_rate = velocity(0.1, 1e-4), 0.8, 0.1
    given.twist.twist.angular.z, given.twist.covariance[35] = yaw_rate, 0.02**2
    (message,) = published_of(RATES, given, track_width=width)
    sides = [1.0 if wheel.side == "left" else -1.0 for wheel in ROVER.wheels]
    speeds = [0.1 - yaw_rate * side * width / 2.0 for side in sides]
    assert message.slip.tolist() == pytest.approx(
        [1.0 - speed / (RADIUS * rate) for speed, rate in zip(speeds, RATES, strict=True)]
    )
    (straight,) = published_of(RATES, given)
    assert straight.slip.tolist() == pytest.approx([1.0 - 0.1 / (RADIUS * w) for w in RATES])
    exact = {"radius_deviation": 0.0}
    (wide,), (narrow,) = (
        published_of(RATES, given, track_width=each, **exact) for each in (width, 0.0)
    )
    ratio = math.hypot(0.01, 0.02 * width / 2.0) / 0.01
    np.testing.assert_allclose(wide.slip_stddev, ratio * narrow.slip_stddev)


@pytest.mark.parametrize(("steering", "sideways"), [("skid", 0.0), ("all_wheels", 0.03)])
def test_motion_across_in_a_turn_is_that_of_the_simulators_wheels(
    steering: str, sideways: float
) -> None:
    track = track_width_of(ROVER)
    config = SimulatorConfig(steering=steering, schedule=FOLLOW, noise=0.0, cross_slope=0.2)
    run, readings = TurningRun(config), []
    for _ in range(20):
        assert run.commands.request((0.08, sideways, 0.0), (0.0, 0.0, 0.05)) == ""
        readings.append(run.step())
    step = step_messages(readings[-1], config, 0, 0)
    source = SlipSource(ROVER, SlipSourceConfig(track_width=track))
    source.pair(JOINTS, step["joint_states"])
    [pair] = source.pair(VELOCITY, step["odom"])
    message, expected = source.slip_message(pair, TYPES.make), step["wheel_slip"]
    np.testing.assert_allclose(message.lateral_slip, expected.lateral_slip, atol=1e-9)
    np.testing.assert_allclose(message.slip_angle, expected.slip_angle, atol=1e-9)
    assert np.abs(message.slip_angle).max() > 0.01


def turning(**changes: float) -> Message:
    """Return a velocity in a turn, with numbers of its covariance or its twist changed."""
    given = velocity(0.1, 1e-4)
    given.twist.twist.linear.y, given.twist.twist.angular.z = changes.get("left", 0.01), 0.1
    given.twist.covariance[7], given.twist.covariance[35] = (
        changes.get(name, 1e-4) for name in ("left_variance", "yaw_variance")
    )
    return given


@pytest.mark.parametrize(
    "changes",
    [
        {"left": math.nan},
        {"left": math.inf},
        {"left_variance": -1.0},
        {"left_variance": 0.0},
        {"yaw_variance": 0.0},
        {"left_variance": math.nan},
        {"yaw_variance": -1.0},
    ],
)
def test_motion_across_is_left_out_where_it_is_not_measured(changes: dict[str, float]) -> None:
    (message,) = published_of(RATES, turning(**changes), track_width=0.8)
    assert message.lateral_slip.size == message.slip_angle.size == 0
    assert np.isfinite(message.slip).all()
    (unknown,) = published_of(RATES, turning())
    assert unknown.lateral_slip.size == unknown.slip_angle.size == 0
    (known,) = published_of([0.0, math.nan, *RATES[2:]], turning(), track_width=0.8)
    for found in (known.lateral_slip, known.slip_angle):
        assert np.isnan(found).tolist() == [True, True, False, False, False, False]


def test_a_steering_joint_without_an_angle_leaves_its_wheel_without_motion_across() -> None:
    names = ("rocker", *ROVER.wheel_names, "front_left_steering", "rear_left_steering")
    given = joints(RATES)
    given.name, given.position = [*names], np.array([*[0.0] * 7, 0.3])
    source = SlipSource(ROVER, SlipSourceConfig(track_width=0.8))
    source.pair(JOINTS, given)
    [pair] = source.pair(VELOCITY, turning())
    message = source.slip_message(pair, TYPES.make)
    (straight,) = published_of(RATES, turning(), track_width=0.8)
    steered, unknown = (ROVER.wheel_names.index(name) for name in ("front_left", "rear_left"))
    assert np.flatnonzero(np.isnan(message.slip_angle)).tolist() == [unknown]
    turned = straight.slip_angle - message.slip_angle
    assert turned[steered] == pytest.approx(0.3)
    assert np.nonzero(turned)[0].tolist() == [steered, unknown]


@pytest.mark.parametrize(("yaw_rate", "variance"), [(math.nan, 1e-4), (0.1, math.inf)])
def test_a_yaw_rate_that_cannot_be_used_is_refused(yaw_rate: float, variance: float) -> None:
    given = velocity(0.1, 1e-4)
    given.twist.twist.angular.z, given.twist.covariance[35] = yaw_rate, variance
    with pytest.raises(SlipSourceError, match=r"yaw rate .*angular\.z and .*, or set track_width"):
        published_of(RATES, given, track_width=0.8)
    assert len(published_of(RATES, given)) == 1


def test_a_wheel_that_stands_has_no_slip_and_one_that_turns_on_the_spot_slips_by_one() -> None:
    (message,) = published([0.0, math.nan, 1.0, 1.0, 1.0, -1.0], 0.0)
    assert (
        np.isnan(message.slip).tolist()
        == np.isnan(message.slip_stddev).tolist()
        == [True, True, False, False, False, False]
    )
    assert message.slip[2] == 1.0
    (message,) = published([0.0, math.inf, *RATES[2:]], 0.1, standstill_speed=0.0)
    assert (
        np.isnan(message.slip).tolist()
        == np.isnan(message.slip_stddev).tolist()
        == [True, True, False, False, False, False]
    )


def test_each_parameter_changes_what_is_published() -> None:
    assert published(RATES, 0.1, body_frame="chassis")[0].header.frame_id == "chassis"
    assert np.isnan(published(RATES, 0.1, standstill_speed=1.0)[0].slip).all()
    plain = published(RATES, 0.1)[0].slip_stddev[0]
    assert published(RATES, 0.1, radius_deviation=0.1)[0].slip_stddev[0] > plain
    assert published(RATES, 0.1, rate_deviation=0.1)[0].slip_stddev[0] > plain
    filled: dict[str, Any] = {"default_sd.velocity": 0.01}
    assert published(RATES, 0.1, 0.0, **filled)[0].slip_stddev[0] > 0.0
    assert len(published(RATES, 0.1, late_ns=50_000_000, pairing_tolerance=0.06)) == 1
    assert published(RATES, 0.1, late_ns=50_000_000) == []
    assert published(RATES, 0.1, late_ns=50_000_000, pairing_tolerance=0.04) == []
    with pytest.raises(ConfigError, match=r"velocity_type.*'radar'.*odometry, twist"):
        published(RATES, 0.1, velocity_type="radar")


@pytest.mark.parametrize(
    ("speed", "variance"),
    [(0.1, 0.0), (0.1, -1.0), (0.1, math.inf), (math.nan, 1e-4), (0.1, math.nan)],
)
def test_a_velocity_that_cannot_be_used_is_refused(speed: float, variance: float) -> None:
    with pytest.raises(SlipSourceError, match="variance"):
        published(RATES, speed, variance)


def test_a_missing_wheel_is_named_with_the_joints_that_are_there() -> None:
    source = SlipSource(ROVER, SlipSourceConfig())
    source.pair(JOINTS, joints(RATES, names=("a", *ROVER.wheel_names[1:])))
    [pair] = source.pair(VELOCITY, velocity(0.1, 1e-4))
    with pytest.raises(SlipSourceError, match=r"front_left.*rocker, a"):
        source.slip_message(pair, TYPES.make)


@pytest.mark.parametrize(
    ("speed", "variance"), [(0.1, 1e308), (1e308, 1e-4), (1e308, 1e308), (0.1, 5e-324)]
)
def test_no_velocity_gives_an_infinite_slip_or_deviation(speed: float, variance: float) -> None:
    (message,) = published(RATES, speed, variance)
    assert not np.isinf([*message.slip, *message.slip_stddev]).any()
    assert np.isfinite(message.slip_stddev).all() == (speed < 1.0)


def test_a_pair_that_cannot_be_used_does_not_take_the_next_one_with_it() -> None:
    source = SlipSource(ROVER, SlipSourceConfig())
    for topic, given in (
        (VELOCITY, velocity(math.nan, 1e-4, 5_000_000)),
        (JOINTS, joints(RATES, 10_000_000)),
        (JOINTS, joints(RATES, 30_000_000)),
    ):
        assert source.pair(topic, given) == []
    first, second = source.pair(VELOCITY, velocity(0.1, 1e-4, 30_000_000))
    with pytest.raises(SlipSourceError, match="velocity nan m/s"):
        source.slip_message(first, TYPES.make)
    assert source.slip_message(second, TYPES.make).sequence == 0
