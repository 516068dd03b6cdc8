# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of a rover that turns: against the planar one, and what its sensors and messages say."""

import cmath
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rover_parameters.records import ConfigError
from rover_sim_node.config import FOLLOW, GroundChange, SimulatorConfig, SoilOverrides
from rover_sim_node.messages import step_messages
from rover_sim_node.reading import SimulatedReading
from rover_sim_node.run import SimulatedRun
from rover_sim_node.turning_run import TurningRun
from rover_sim_node.twist_commands import SHARPEST
from rover_sim_node.viewing import marker_message
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.estimator.off_plane import refuse_off_plane
from terrain_estimator.messaging.conversion import Converter
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terramechanics import presets
from terramechanics.description.layout import track_width_of, wheel_centres
from terramechanics.presets import load_rover
from terramechanics.simulation.sensors import LATERAL_SD, YAW_RATE_SD
from terramechanics.simulation.spatial import Plane
from terramechanics.vehicle.stance import rotation

NOTHING = (0.0, 0.0, 0.0)
SKID = SimulatorConfig(rover="four_wheel_rover", steering="skid", schedule=FOLLOW, noise=0.0)
STEERED = SimulatorConfig(rover="mars_rover", steering="all_wheels", schedule=FOLLOW, noise=0.0)
Twist = tuple[float, float, float]  # v_x, v_y, yaw rate


def driven(config: SimulatorConfig, twist: Twist, steps: int) -> list[SimulatedReading]:
    run, found = TurningRun(config), []
    for _ in range(steps):
        assert run.commands.request((*twist[:2], 0.0), (0.0, 0.0, twist[2])) == ""
        found.append(run.step())
    return found


def observed(reading: SimulatedReading, config: SimulatorConfig) -> Observation:
    messages = step_messages(reading, config, round(1e9 * reading.time), 0)
    converter = Converter(load_rover(config.rover), ConversionConfig(), CoreConfig())
    names = ("wheel_slip", "wheel_sinkage", "odom", "joint_states", "imu")
    found = converter.convert(1, tuple(messages[name] for name in names)).observation
    assert found is not None
    return found


@pytest.mark.parametrize("rover", ["four_wheel_rover", "mars_rover"])
def test_straight_ahead_it_is_the_planar_rover(rover: str) -> None:
    config = dataclasses.replace(SKID, rover=rover)
    planar = SimulatedRun(dataclasses.replace(config, steering=""))
    assert planar.commands is not None
    read = []
    for _ in range(30):
        assert planar.commands.request((0.1, 0.0, 0.0), NOTHING) == ""
        read.append(planar.step())
    other = driven(config, (0.1, 0.0, 0.0), 30)[-1]
    one = read[-1]
    for name in ("velocity", "slip", "sinkage", "torque", "wheel_rate", "acceleration"):
        expected, found = (getattr(each.measured, name) for each in (one, other))
        assert torch.allclose(found, expected, rtol=1e-6, atol=1e-9), name
    assert torch.allclose(other.ground_force, one.ground_force, rtol=1e-6, atol=1e-6)


def test_wheels_of_a_turning_skid_steer_slip_differently_left_and_right() -> None:
    last = driven(SKID, (0.2, 0.0, 0.4), 60)[-1]
    sides = [wheel.side for wheel in last.rover.wheels]
    left, right = (
        [
            slip
            for slip, side in zip(last.measured.slip.tolist(), sides, strict=True)
            if side == each
        ]
        for each in ("left", "right")
    )
    assert max(left) < 0.1
    assert min(right) > 0.3
    assert 0.02 < last.sideways.yaw_rate < 0.4
    assert last.steering is None


@pytest.mark.parametrize(
    ("config", "twist"),
    [
        (SKID, (0.2, 0.0, 0.4)),
        (SKID, (-0.2, 0.0, 0.2)),
        (dataclasses.replace(STEERED, cross_slope=0.2), (0.08, 0.03, 0.05)),
        (dataclasses.replace(STEERED, cross_slope=0.2, noise=1.0), (0.08, 0.0, -0.05)),
    ],
)
def test_motion_across_is_that_of_the_body_at_the_place_of_each_hub(
    config: SimulatorConfig, twist: Twist
) -> None:
    run, readings = TurningRun(config), []
    for _ in range(40):
        assert run.commands.request((*twist[:2], 0.0), (0.0, 0.0, twist[2])) == ""
        readings.append(run.step())
    reading = readings[-1]
    rover, body = run.rover, run._simulation
    ahead, left, turn = body.velocity[0].tolist()
    steering = [0.0] * len(rover.wheels) if reading.steering is None else reading.steering.tolist()
    message = step_messages(reading, config, 0, 0)["wheel_slip"]
    for k, (x, y, _) in enumerate(wheel_centres(rover, track_width_of(rover))):
        moved = complex(ahead - turn * y, left + turn * (x - rover.centre_of_mass_x))
        hub = moved * cmath.exp(-1j * steering[k])
        rim = rover.wheel_radius * abs(float(reading.measured.wheel_rate[k]))
        assert message.lateral_slip[k] == pytest.approx(hub.imag / rim, abs=1e-9)
        assert message.slip_angle[k] == pytest.approx(cmath.phase(hub), abs=1e-9)
    assert max(map(abs, message.lateral_slip)) > 0.01


def test_dead_reckoning_without_noise_is_the_way_that_was_driven() -> None:
    """A quarter of a circle: its chord and its turn, from the rates of the body."""
    readings = driven(STEERED, (0.08, 0.0, 0.05), 300)
    last, way = readings[-1], sum(0.1 * float(each.measured.velocity) for each in readings)
    turn = last.sideways.yaw
    radius = way / turn
    x, y, z = last.odometry
    assert 1.0 < turn < 1.6
    assert x == pytest.approx(radius * math.sin(turn), rel=0.02)
    assert y == pytest.approx(radius * (1.0 - math.cos(turn)), rel=0.02)
    assert z == 0.0
    assert last.position == pytest.approx(way, rel=0.01)


def test_the_spread_of_dead_reckoning_grows_as_its_errors_add_up() -> None:
    """Straight ahead: y has the integral of the yaw's error, and the lateral velocity's."""
    steps, config = 100, dataclasses.replace(STEERED, noise=1.0)
    readings = driven(config, (0.08, 0.0, 0.0), steps)
    last = readings[-1]
    assert readings[0].sideways.yaw_sd == pytest.approx(0.1 * YAW_RATE_SD)
    assert last.sideways.yaw_sd**2 == pytest.approx(steps * (0.1 * YAW_RATE_SD) ** 2)
    way = np.array([0.1 * float(each.measured.velocity) for each in readings])
    ahead = np.cumsum(way[::-1])[::-1]  # that is still to come after each step's turn
    by_turn = float(((ahead[1:] * 0.1 * YAW_RATE_SD) ** 2).sum())
    assert last.odometry_variance[1] == pytest.approx(
        by_turn + steps * (0.1 * LATERAL_SD) ** 2, rel=0.05
    )
    assert abs(last.sideways.yaw) < 4.0 * last.sideways.yaw_sd


def test_the_spread_of_the_height_is_that_of_many_runs() -> None:
    """Crabbing across a slope, 60 runs: within 30 %, three deviations of such a spread."""
    heights, stated = [], []
    for seed in range(60):
        config = dataclasses.replace(STEERED, noise=1.0, cross_slope=0.2, seed=seed)
        last = driven(config, (0.0, 0.1, 0.0), 12)[-1]
        heights.append(last.odometry[2])
        stated.append(math.sqrt(last.odometry_variance[2]))
    assert np.std(heights) == pytest.approx(np.mean(stated), rel=0.3)


def test_no_variance_is_zero_from_the_first_message_on() -> None:
    for noise in (0.0, 1.0):
        config = dataclasses.replace(STEERED, noise=noise)
        messages = step_messages(driven(config, (0.0, 0.0, 0.0), 1)[0], config, 1, 0)
        odometry, imu = messages["odom"], messages["imu"]
        for covariance, size in (
            (odometry.pose.covariance, 6),
            (odometry.twist.covariance, 6),
            (imu.orientation_covariance, 3),
            (imu.angular_velocity_covariance, 3),
        ):
            assert (np.asarray(covariance).reshape(size, size).diagonal() > 0.0).all()


def test_accelerometers_feel_the_turn_and_the_slope() -> None:
    turn = driven(dataclasses.replace(STEERED, rover="four_wheel_rover"), (0.3, 0.0, 0.3), 60)[-1]
    assert turn.specific_force is not None
    inward = float(turn.measured.velocity) * turn.sideways.yaw_rate
    assert turn.specific_force[0] == pytest.approx(inward, rel=0.1)
    slope = driven(dataclasses.replace(SKID, cross_slope=0.3), (0.1, 0.0, 0.0), 40)[-1]
    felt = step_messages(slope, SKID, 1, 0)["imu"].linear_acceleration
    assert math.hypot(felt.x, felt.y, felt.z) == pytest.approx(slope.rover.gravity, rel=1e-3)
    assert felt.y == pytest.approx(slope.rover.gravity * math.sin(0.3), rel=0.01)


def test_crabbing_on_a_slope_is_reckoned_in_three_dimensions() -> None:
    """The way on the plane, turned into the world, is what the odometry has."""
    slopes = 0.15, 0.15
    config = dataclasses.replace(
        STEERED, profile="ramp", ramp_grade=slopes[0], cross_slope=slopes[1]
    )
    run, way = TurningRun(config), np.zeros(3)
    first, second = (math.tan(each) for each in slopes)
    along = np.array([1.0, 0.0, first]) / math.hypot(1.0, first)
    normal = np.array([-first, -second, 1.0])
    across = np.cross(normal / np.linalg.norm(normal), along)
    last = run.step()
    for _ in range(60):
        assert run.commands.request((0.0, 0.1, 0.0), NOTHING) == ""
        last = run.step()
        moved = float(last.measured.velocity), last.sideways.lateral_velocity
        turned = last.sideways.yaw
        ahead = math.cos(turned) * along + math.sin(turned) * across
        left = math.cos(turned) * across - math.sin(turned) * along
        way += 0.1 * (moved[0] * ahead + moved[1] * left)
    assert last.odometry[1] > 0.1
    assert np.array(last.odometry) == pytest.approx(way, abs=0.01 * math.hypot(*way))


def test_over_hills_it_leans_every_way_and_says_so() -> None:
    """The reckoned height is that of the ground, to what the noise-free sensors leave out."""
    config = dataclasses.replace(STEERED, profile="hills", seed=4)
    run = TurningRun(config)
    simulation = run._simulation
    start = simulation._surface.shape(torch.zeros(1, 1, 2, dtype=torch.float64))[0]
    found = []
    for _ in range(300):
        assert run.commands.request((0.1, 0.0, 0.0), (0.0, 0.0, 0.02)) == ""
        found.append(run.step())
    angles = torch.stack([each.measured.contact_angle for each in found])
    bogie = np.array([each.bogie_angle for each in found])
    pitch = np.array([float(each.measured.pitch) for each in found])
    roll = np.array([each.sideways.roll for each in found])
    for leaned in (
        angles.amax(0) - angles.amin(0),
        bogie.max() - bogie.min(),
        np.ptp(pitch),
        np.ptp(roll),
    ):
        assert float(np.min(np.asarray(leaned))) > 0.005
    rates = 10.0 * np.diff(bogie)
    assert [each.bogie_rate for each in found[1:]] == pytest.approx(rates.tolist())
    climbed = simulation._surface.shape(simulation.position.unsqueeze(1))[0] - start
    assert abs(float(climbed)) > 0.02
    assert found[-1].odometry[2] == pytest.approx(float(climbed), abs=0.01)
    again = driven(config, (0.1, 0.0, 0.02), 20)[-1]
    assert torch.equal(again.measured.contact_angle, found[19].measured.contact_angle)


@pytest.mark.parametrize(
    ("effect", "size", "signal"),
    [
        ("grousers", 20.0, "torque"),
        ("lateral_bulldozing", 2e5, "slip"),
        ("sinkage_bias", 0.01, "sinkage"),
        ("latency", 0.5, "slip"),
    ],
)
def test_an_effect_acts_on_a_rover_that_turns(effect: str, size: float, signal: str) -> None:
    changed = dataclasses.replace(SKID, effect=effect, effect_size=size)
    with_effect, bare = (driven(each, (0.2, 0.0, 0.5), 15)[-1] for each in (changed, SKID))
    moved = getattr(with_effect.measured, signal) - getattr(bare.measured, signal)
    assert float(moved.abs().max()) > 0.005 * float(getattr(bare.measured, signal).abs().max())


def test_a_rover_turns_on_the_spot_crabs_and_backs() -> None:
    spot = driven(STEERED, (0.0, 0.0, 0.1), 40)[-1]
    assert spot.sideways.yaw > 0.15
    assert math.hypot(*spot.odometry[:2]) < 0.01
    crab = driven(STEERED, (0.0, 0.05, 0.0), 40)[-1]
    assert crab.steering is not None
    assert torch.allclose(crab.steering, torch.full((6,), math.pi / 2.0, dtype=torch.float64))
    assert crab.odometry[1] > 0.1 > abs(crab.odometry[0])
    back = driven(STEERED, (-0.08, 0.0, 0.0), 40)[-1]
    assert float(back.measured.velocity) < -0.05
    assert float(back.measured.slip.min()) > 0.1


def test_across_a_slope_it_leans_and_the_attitude_says_so() -> None:
    """What the messages' attitude makes of the vertical is what the simulation makes of it."""
    slopes = 0.1, 0.08
    config = dataclasses.replace(SKID, profile="ramp", ramp_grade=slopes[0], cross_slope=slopes[1])
    last = driven(config, (0.15, 0.0, 0.6), 60)[-1]
    turned = step_messages(last, config, 1, 0)["imu"].orientation
    x, y, z, w = turned.x, turned.y, turned.z, turned.w
    up = [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)]
    heading = torch.tensor([last.sideways.yaw], dtype=torch.float64)
    plane = Plane(*map(math.tan, slopes))
    none = torch.zeros(1, dtype=torch.float64)
    felt = rotation(heading, none, none)[0].T @ plane.gravity(1.0)
    assert up == pytest.approx((-felt).tolist(), abs=2e-3)
    assert last.sideways.yaw > 0.1
    assert last.odometry[2] > 0.0


def test_messages_carry_what_a_planar_rover_has_not() -> None:
    config = dataclasses.replace(STEERED, noise=1.0)
    last = driven(config, (0.08, 0.0, 0.05), 40)[-1]
    messages = step_messages(last, config, 1, 0)
    twist = messages["odom"].twist
    assert twist.twist.angular.z == last.sideways.yaw_rate
    assert math.sqrt(twist.covariance[35]) == pytest.approx(YAW_RATE_SD)
    assert math.sqrt(twist.covariance[7]) == pytest.approx(LATERAL_SD)
    joints = messages["joint_states"]
    steering = [name for name in joints.name if name.endswith("_steering")]
    assert len(steering) == len(last.rover.wheels)
    assert len(joints.position) == len(joints.name) == len(joints.effort)
    assert messages["imu"].angular_velocity_covariance[8] > 0.0
    seen = observed(last, config)
    assert seen.yaw_rate == pytest.approx(last.sideways.yaw_rate)
    assert seen.lateral_velocity == pytest.approx(last.sideways.lateral_velocity)


@pytest.mark.parametrize(
    ("twist", "slope", "refused"),
    [((0.2, 0.0, 0.0), 0.0, False), ((0.4, 0.0, 0.6), 0.0, True), ((0.2, 0.0, 0.0), 0.1, True)],
)
def test_the_estimator_refuses_its_turns_and_cross_slopes(
    twist: Twist, slope: float, *, refused: bool
) -> None:
    config = dataclasses.replace(SKID, cross_slope=slope)
    seen = observed(driven(config, twist, 40)[-1], config)
    rover = load_rover(config.rover)
    rims = (seen.wheel_rate * rover.wheel_radius).tolist()
    refusal = refuse_off_plane(seen, rims, rover, CoreConfig())
    assert (refusal is not None) == refused
    if refusal is not None:
        assert refusal[0] is Outcome.NOT_PLANAR


def test_wheels_that_turn_without_moving_the_rover_are_stuck() -> None:
    config = dataclasses.replace(SKID, profile="ramp", ramp_grade=0.5)
    readings = driven(config, (0.3, 0.0, 0.0), 40)
    assert not readings[0].stuck
    assert readings[-1].stuck


def test_a_rover_that_slides_back_is_stuck() -> None:
    soft = SoilOverrides(tan_phi=0.3, cohesion=100.0)
    config = dataclasses.replace(SKID, profile="ramp", ramp_grade=0.5, soil_overrides=soft)
    last = driven(config, (0.3, 0.0, 0.0), 25)[-1]
    assert float(last.measured.velocity) < -0.1
    assert last.stuck


def test_the_arrow_of_a_wheel_across_a_slope_leans_to_the_side_that_holds_it() -> None:
    config = dataclasses.replace(STEERED, cross_slope=0.25)
    last = driven(config, (0.05, 0.0, 0.0), 30)[-1]
    assert last.ground_force[:, 3].min() > 5.0  # uphill is to the left
    header = step_messages(last, config, 1, 0)["imu"].header
    arrows = [each for each in marker_message(last, header, 0.0).markers if each.ns == "forces"]
    assert all(each.points[1].y > each.points[0].y for each in arrows)


def test_the_same_seed_gives_the_same_run() -> None:
    config = dataclasses.replace(STEERED, noise=1.0)
    one, other = (driven(config, (0.05, 0.0, 0.02), 15) for _ in range(2))
    for here, there in zip(one, other, strict=True):
        assert here.odometry == there.odometry
        assert torch.equal(here.measured.slip.nan_to_num(), there.measured.slip.nan_to_num())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"steering": "tracks"}, "parameter steering: 'tracks' is unknown, give one of skid"),
        ({"schedule": "S1"}, "parameter schedule: S1 drives straight ahead"),
        ({"profile": "step"}, "parameter profile: step is not simulated with steering skid"),
        ({"effect": "failed_wheel"}, "parameter effect: failed_wheel is not simulated"),
        ({"effect": "contact_law_scm"}, "parameter effect: contact_law_scm is not simulated"),
        ({"effect": "bulldozing"}, "parameter effect_size: give the size of bulldozing"),
        ({"effect_size": 3.0}, "parameter effect_size: 3 does nothing without a name"),
        ({"change": GroundChange(soil="regolith")}, r"parameter change\.soil: regolith"),
        ({"cmd_vel_timeout": 0.1, "rate": 5.0}, "cmd_vel_timeout"),
    ],
)
def test_what_is_not_simulated_is_refused_by_name(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        TurningRun(dataclasses.replace(SKID, **changes))


@pytest.mark.parametrize("name", ["cross_slope", "yaw_inertia"])
def test_a_planar_rover_refuses_parameters_of_one_that_turns(name: str) -> None:
    given: dict[str, Any] = {name: 0.2}
    with pytest.raises(ConfigError, match=f"parameter {name}: 0.2 does nothing"):
        SimulatedRun(SimulatorConfig(**given))


def refusal_of(config: SimulatorConfig, linear: Sequence[float], angular: Sequence[float]) -> str:
    commands = TurningRun(config).commands
    return commands.request((linear[0], linear[1], linear[2]), (angular[0], angular[1], angular[2]))


@pytest.mark.parametrize(
    ("config", "linear", "angular", "words"),
    [
        (SKID, (0.1, 0.1, 0.0), NOTHING, "does not move sideways"),
        (SKID, (0.1, 0.0, 0.1), NOTHING, "moves on the ground"),
        (SKID, (0.1, 0.0, 0.0), (0.1, 0.0, 0.0), "moves on the ground"),
        (SKID, (math.nan, 0.0, 0.0), NOTHING, "not finite"),
        (SKID, (0.9, 0.0, 0.0), (0.0, 0.0, 1.0), "beyond 1"),
        (
            dataclasses.replace(STEERED, steering="ackermann"),
            (0.02, 0.0, 0.0),
            (0.0, 0.0, 0.1),
            "turn less",
        ),
    ],
)
def test_a_command_that_cannot_be_followed_is_refused(
    config: SimulatorConfig, linear: Sequence[float], angular: Sequence[float], words: str
) -> None:
    assert words in refusal_of(config, linear, angular)


def test_rear_wheels_of_ackermann_steering_stay_straight() -> None:
    config = dataclasses.replace(STEERED, steering="ackermann")
    last = driven(config, (0.08, 0.0, 0.03), 20)[-1]
    assert last.steering is not None
    rear = max(last.rover.wheel_axle)
    for wheel, angle in zip(last.rover.wheels, last.steering.tolist(), strict=True):
        assert (abs(angle) < 1e-9) == (wheel.axle == rear)


@pytest.mark.parametrize("target", [(0.3, 0.1), (-0.3, -0.1)])
def test_ackermann_steering_stays_below_its_limit_from_the_start_and_in_a_reversal(
    target: tuple[float, float],
) -> None:
    run = TurningRun(dataclasses.replace(STEERED, steering="ackermann"))
    sharpest = []
    for speed, turn in (target, (-target[0], -target[1])):
        for _ in range(30):
            assert run.commands.request((speed, 0.0, 0.0), (0.0, 0.0, turn)) == ""
            angles = run.step().steering
            assert angles is not None
            sharpest.append(float(angles.abs().max()))
    assert max(sharpest) <= SHARPEST + 1e-9
    assert sharpest[29] > 0.1


def test_a_rover_file_with_two_left_wheels_on_an_axle_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rover.yaml"
    text = (Path(presets.__file__).parent / "rovers" / "four_wheel_rover.yaml").read_text()
    path.write_text(text.replace("side: right", "side: left", 1))
    with pytest.raises(ConfigError, match="as many wheels left as right"):
        TurningRun(dataclasses.replace(SKID, rover=str(path)))


def test_accelerations_are_bounded_and_a_stale_command_stops_it() -> None:
    run = TurningRun(dataclasses.replace(SKID, cmd_vel_acceleration=0.2, cmd_vel_timeout=0.5))
    assert run.commands.request((0.1, 0.0, 0.0), NOTHING) == ""
    rims = [float(run.commands.command(0.1 * k)[0].amax()) for k in range(1, 11)]
    assert rims[:5] == pytest.approx([0.02, 0.04, 0.06, 0.08, 0.1])
    assert rims[5:] == pytest.approx([0.08, 0.06, 0.04, 0.02, 0.0], abs=1e-12)
