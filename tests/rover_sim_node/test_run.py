# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive and its messages, without processes."""

import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rover_parameters.records import ConfigError
from rover_sim_node.config import FOLLOW, GroundChange, SimulatorConfig, SoilOverrides
from rover_sim_node.messages import clock_message, step_messages, truth_message
from rover_sim_node.reading import SimulatedReading
from rover_sim_node.run import SimulatedRun
from terrain_estimator.offline import run_report
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground

CONFIG = SimulatorConfig(seed=5)
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
LINEAR = str(EXAMPLES / "closed_form" / "linear_stress_loose_sand.yaml")


def readings(config: SimulatorConfig, steps: int) -> list[SimulatedReading]:
    run = SimulatedRun(config)
    return [run.step() for _ in range(steps)]


def messages(config: SimulatorConfig, steps: int) -> list[dict[str, Any]]:
    return [
        step_messages(reading, config, round(reading.time * 1e9), n)
        for n, reading in enumerate(readings(config, steps))
    ]


def test_the_drive_is_the_one_that_a_batch_simulates() -> None:
    generator = torch.Generator().manual_seed(2 * CONFIG.seed)
    drive = simulate(
        load_rover("mars_rover"), Ground.constant(load_soil("loose_sand")), "S1", 3.0, generator, 1
    )
    exact = readings(dataclasses.replace(CONFIG, noise=0.0), 30)
    assert [float(reading.measured.velocity) for reading in exact] == drive.sample.velocity[
        0
    ].tolist()
    assert [reading.measured.slip[::2].tolist() for reading in exact] == drive.sample.slip[
        0
    ].tolist()
    assert [
        reading.measured.wheel_rate[1::2].tolist() for reading in exact
    ] == drive.sample.wheel_rate[0].tolist()


def plain(message: Any) -> object:
    """Every value of a message, exactly. (Not its bytes: what pads them is garbage.)"""
    if hasattr(message, "get_fields_and_field_types"):
        return {
            name: plain(getattr(message, name)) for name in message.get_fields_and_field_types()
        }
    if isinstance(message, float):
        return message.hex()
    if isinstance(message, str | int):
        return message
    return [plain(item) for item in list(message)]


def test_the_same_seed_gives_the_same_messages_and_another_seed_others() -> None:
    first, again, other = (
        [plain_step(step) for step in messages(dataclasses.replace(CONFIG, seed=seed), 10)]
        for seed in (5, 5, 6)
    )
    assert first == again
    assert first[0]["wheel_slip"] != other[0]["wheel_slip"]


def plain_step(step: dict[str, Any]) -> dict[str, object]:
    return {topic: plain(message) for topic, message in step.items()}


def test_errors_are_as_large_as_the_published_deviations_and_another_in_every_wheel() -> None:
    """Compare 3600 errors, 60 s of 6 wheels, with the published deviations.

    Their mean square in units of the deviations is 1 within 4.5 sqrt(2 / 3600), and 5 % for
    deviations that follow from measured values.
    """
    steps = 600
    noisy, exact = readings(CONFIG, steps), readings(dataclasses.replace(CONFIG, noise=0.0), steps)
    for name in ("slip", "sinkage", "contact_angle", "torque"):
        values, deviations, truths = (
            torch.stack([getattr(reading.measured, key) for reading in run])
            for run, key in ((noisy, name), (noisy, f"{name}_sd"), (exact, name))
        )
        errors = (values - truths) / deviations
        assert float((errors**2).mean()) == pytest.approx(
            1.0, abs=4.5 * math.sqrt(2.0 / 3600.0) + 0.05
        ), name
        between_wheels = torch.corrcoef(errors.T) - torch.eye(6, dtype=torch.float64)
        assert float(between_wheels.abs().max()) < 5.0 / math.sqrt(steps), name
    velocity = torch.stack([reading.measured.velocity for reading in noisy]) - torch.stack(
        [reading.measured.velocity for reading in exact]
    )
    assert float(velocity.std()) == pytest.approx(0.01, rel=4.5 / math.sqrt(2.0 * steps))


def test_every_message_of_a_step_has_the_same_stamp_and_its_frame() -> None:
    for n, step in enumerate(messages(CONFIG, 5)):
        stamps = {
            (message.header.stamp.sec, message.header.stamp.nanosec) for message in step.values()
        }
        assert stamps == {(0, (n + 1) * 100_000_000)}
        assert step["wheel_slip"].sequence == step["wheel_sinkage"].sequence == n
        assert {topic: message.header.frame_id for topic, message in step.items()} == {
            "wheel_slip": "base_link", "wheel_sinkage": "base_link", "odom": "odom",
            "joint_states": "base_link", "imu": "base_link",
        }  # fmt: skip
        assert step["odom"].child_frame_id == "base_link"


def test_wheels_and_suspension_joints_are_named() -> None:
    (step,) = messages(CONFIG, 1)
    wheels = ["front_left", "front_right", "middle_left", "middle_right", "rear_left", "rear_right"]
    assert step["wheel_slip"].wheel == step["wheel_sinkage"].wheel == wheels
    joints = step["joint_states"]
    assert joints.name == [*wheels, "rocker", "bogie"]
    assert len(joints.position) == len(joints.velocity) == len(joints.effort) == 8
    assert math.isnan(joints.effort[6])


def test_a_climb_is_a_negative_rotation_about_y_and_specific_force_pulls_back() -> None:
    config = SimulatorConfig(schedule="S3", profile="ramp", ramp_grade=0.1, noise=0.0)
    last = messages(config, 250)[-1]
    for orientation in (last["imu"].orientation, last["odom"].pose.pose.orientation):
        assert 2.0 * math.asin(orientation.y) == pytest.approx(-0.1, abs=1e-6)
        assert orientation.w > 0.0
    assert last["imu"].linear_acceleration.x == pytest.approx(3.72 * math.sin(0.1), abs=1e-3)
    assert last["imu"].linear_acceleration.z == pytest.approx(3.72 * math.cos(0.1), abs=1e-3)
    assert last["odom"].pose.pose.position.z > 0.0


def test_covariances_are_filled_positive_and_grow_with_the_way_for_the_pose() -> None:
    first, *_, last = messages(CONFIG, 40)
    for step in (first, last):
        pose, twist = (
            np.asarray(covariance).reshape(6, 6)
            for covariance in (step["odom"].pose.covariance, step["odom"].twist.covariance)
        )
        assert np.linalg.eigvalsh(pose).min() > 0.0
        assert np.linalg.eigvalsh(twist).min() > 0.0
        assert twist[0, 0] == pytest.approx(0.01**2)
        assert pose[4, 4] == pytest.approx(math.radians(0.3) ** 2)
        orientation = np.asarray(step["imu"].orientation_covariance).reshape(3, 3)
        assert orientation[1, 1] == pytest.approx(math.radians(0.3) ** 2)
        assert step["imu"].angular_velocity_covariance[0] == -1.0
        assert np.asarray(step["imu"].linear_acceleration_covariance).reshape(3, 3)[
            0, 0
        ] == pytest.approx(2.0 * 0.02**2)
    assert last["odom"].pose.covariance[0] > 10.0 * first["odom"].pose.covariance[0]


def test_the_odometry_of_exact_sensors_is_the_integral_of_velocity() -> None:
    exact = readings(SimulatorConfig(noise=0.0, seed=2), 100)
    way = sum(
        0.1 * float(item.measured.velocity) * math.cos(float(item.measured.pitch)) for item in exact
    )
    assert exact[-1].odometry[0] == pytest.approx(way)
    turned = sum(0.1 * float(item.measured.wheel_rate[0]) for item in exact)
    assert float(exact[-1].wheel_angle[0]) == pytest.approx(turned)


@pytest.mark.parametrize(("transition", "grounds"), [(0.0, 2), (0.5, 5)])
def test_the_truth_follows_a_change_of_the_ground(transition: float, grounds: int) -> None:
    change = GroundChange(soil="compact_sand", position=0.4, transition=transition)
    config = SimulatorConfig(
        change=change, soil_overrides=SoilOverrides(cohesion=1500.0, tan_phi=0.7), schedule="S3"
    )
    truths = [reading.truth for reading in readings(config, 150)]
    assert truths[0].strength == (1500.0, 0.7)
    assert [soil for soil, _ in itertools.groupby(truth.soil for truth in truths)] == [
        "loose_sand",
        "compact_sand",
    ]
    assert truths[-1].strength == pytest.approx((690.0, 0.6569))
    assert len({truth.strength for truth in truths}) >= grounds
    message = truth_message(truths[-1], config, 15_000_000_000, 3)
    assert message.sinkage_exponent == pytest.approx(0.47)
    assert message.friction_angle == pytest.approx(math.atan(0.6569))
    assert (message.shear_modulus, message.stress_angle_offset, message.sequence) == (
        pytest.approx(0.038),
        pytest.approx(0.43),
        3,
    )
    assert list(message.effect) == []


@pytest.mark.parametrize(
    ("effect", "size", "told", "ground"),
    [
        ("payload", 40.0, [("payload", 40.0, "kg")], "loose_sand with payload 40 kg"),
        ("multipass", 0.1, [("multipass", 0.1, "1")], "loose_sand with multipass 0.1"),
        ("failed_wheel", 1.0, [("failed_wheel", 1.0, "1")], "loose_sand with failed_wheel 1"),
        ("payload", 0.0, [], "loose_sand"),
    ],
)
def test_the_truth_names_the_effect_with_its_size_and_the_report_of_a_run_shows_it(
    effect: str, size: float, told: list[tuple[str, float, str]], ground: str
) -> None:
    config = SimulatorConfig(effect=effect, effect_size=size)
    (reading,) = readings(config, 1)
    message = truth_message(reading.truth, config, 0, 0)
    assert list(zip(message.effect, message.effect_value, message.effect_unit, strict=True)) == told
    assert run_report._truth(message).ground == ground


def test_a_wheel_straight_ahead_has_no_motion_across_and_one_that_stands_none_to_tell() -> None:
    steps = messages(CONFIG, 20)
    for step in steps:
        slip = step["wheel_slip"]
        assert step["wheel_sinkage"].reference == "undisturbed"
        expected = [slips * 0.0 for slips in slip.slip]
        for found in (slip.lateral_slip, slip.slip_angle):
            np.testing.assert_array_equal(found, expected)
    assert any(np.isfinite(step["wheel_slip"].slip).all() for step in steps)
    standing = dataclasses.replace(CONFIG, schedule=FOLLOW)
    (step,) = messages(standing, 1)
    assert np.isnan(step["wheel_slip"].lateral_slip).tolist() == [True] * 6
    assert np.isnan(step["wheel_slip"].slip_angle).tolist() == [True] * 6


def test_a_rover_without_commands_stands_and_its_slip_is_undefined() -> None:
    step, *_ = messages(SimulatorConfig(schedule="cmd_vel"), 3)
    assert all(math.isnan(slip) for slip in step["wheel_slip"].slip)
    assert all(math.isfinite(depth) for depth in step["wheel_sinkage"].sinkage)
    assert not any(step["joint_states"].velocity[:6])


def test_another_rate_gives_other_steps() -> None:
    fast = readings(dataclasses.replace(CONFIG, rate=20.0), 4)
    assert [reading.time for reading in fast] == pytest.approx([0.05, 0.1, 0.15, 0.2])


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (SimulatorConfig(soil="mud"), "mud: neither one of the soils"),
        (
            SimulatorConfig(effect="ice"),
            "effect: unknown effect 'ice'; known effects are slope_bias, bulldozing",
        ),
        (
            SimulatorConfig(effect="payload", effect_size=900.0),
            r"payload: size 900 is outside its physical range, -80 to 150 \[kg\]",
        ),
        (
            SimulatorConfig(effect="payload"),
            r"effect_size: give the size of payload, -80 to 150 \[kg\]; without one the effect",
        ),
        (SimulatorConfig(effect_size=0.1), "effect_size: 0.1 does nothing without a name"),
        (SimulatorConfig(effect="lateral_bulldozing"), "lateral_bulldozing acts sideways"),
        (
            SimulatorConfig(soil=LINEAR, effect="exit_angle", effect_size=0.3),
            "parameter effect: exit_angle is not simulated on soils of law linear_stress",
        ),
        (
            SimulatorConfig(soil=LINEAR, change=GroundChange(soil="compact_sand")),
            r"change\.soil: compact_sand has law wong_reece, linear_stress_loose_sand before it",
        ),
        (SimulatorConfig(rover="car"), "car: neither one of the rovers"),
        (
            SimulatorConfig(schedule="S9"),
            "parameter schedule: 'S9' is unknown, give one of S1, S2, S3, S4, cmd_vel",
        ),
        (
            SimulatorConfig(profile="moon"),
            "parameter profile: 'moon' is unknown, give one of flat, hills, ramp, step or nothing",
        ),
        (SimulatorConfig(change=GroundChange(soil="ice")), "ice: neither one of the soils"),
        (SimulatorConfig(soil_overrides=SoilOverrides(k_c=-1e9)), "would carry nothing"),
    ],
)
def test_a_wrong_name_is_refused(config: SimulatorConfig, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        SimulatedRun(config)


def test_the_clock_message_carries_the_time() -> None:
    clock = clock_message(12_300_000_000).clock
    assert (clock.sec, clock.nanosec) == (12, 300_000_000)


def test_an_effect_acts_on_what_is_measured_and_without_size_on_nothing() -> None:
    plain, nothing, biased = (
        SimulatedRun(config).step().measured
        for config in (
            SimulatorConfig(seed=3),
            SimulatorConfig(seed=3, effect="sinkage_bias", effect_size=0.0),
            SimulatorConfig(seed=3, effect="sinkage_bias", effect_size=0.004, noise=1.0),
        )
    )
    assert plain.sinkage.tolist() == nothing.sinkage.tolist()
    assert (biased.sinkage - plain.sinkage).tolist() == pytest.approx([0.004] * 6, rel=0.2)
    assert biased.torque.tolist() == plain.torque.tolist()
