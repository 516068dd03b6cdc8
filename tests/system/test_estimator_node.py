# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator as a process of its own, on real DDS."""

import math
import signal
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from std_srvs.srv import Trigger

from msg_defs.msg import EstimatorHealth, MotionPrediction, TerrainEstimate
from terrain_estimator.learning.export import export
from terrain_estimator.learning.training import build_model
from terrain_estimator.model.metadata import VELOCITY_ALONE, Training
from terrain_estimator.nodes.common import message_types
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import INPUT_TYPES
from terramechanics.presets import load_rover, load_soil
from tests.drives import JOINTS, STEP_NS, Event, drive_messages
from tests.soundness import unsound
from tests.system.listening import Listener
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until

SECONDS = 6.0


class Rover:
    """Publishes the estimator's inputs, and collects what it answers."""

    def __init__(self, listener: Listener, estimator: Process) -> None:
        self._listener, self._estimator = listener, estimator
        self.estimates = listener.collect(TerrainEstimate, "terrain_estimate")
        self.predictions = listener.collect(MotionPrediction, "motion_prediction")
        self.health = listener.collect(EstimatorHealth, "estimator_health")
        self._publishers: dict[str, Publisher] = {
            topic: listener.publisher(message_types.message_class(type_name), topic)
            for topic, type_name in INPUT_TYPES.items()
        }
        for subscription in listener.node.subscriptions:
            listener.spin_until(
                subscription.get_publisher_count, f"{subscription.topic_name} is matched"
            )
        estimator.wait_for_output("matched all inputs")

    def send(self, events: list[Event]) -> None:
        """Publish in this order."""
        for topic, _, message in events:
            self._publishers[topic].publish(message)

    def drive(self, events: list[Event], waiting: int = 0) -> list[Any]:
        """Send second by second; return the new estimates.

        Waits for an estimate of each instant but the last `waiting`.
        """
        before, done = len(self.estimates), 0
        instants = sorted({stamp for _, stamp, _ in events})
        for start in range(0, len(instants), 10):
            chosen = set(instants[start : start + 10])
            self.send([event for event in events if event[1] in chosen])
            done += len(chosen)
            self._listener.wait_for_messages(self.estimates, before + done - waiting)
        return list(self.estimates[before:])

    def counted(self, accepted: int) -> Any:
        """Return the first report of health with so many accepted observations."""
        found = lambda: next((each for each in self.health if each.accepted == accepted), None)  # noqa: E731
        return self._listener.spin_until(found, f"{accepted} are reported as accepted")

    def reset(self) -> None:
        """Back to the prior."""
        assert self._listener.call(Trigger, "estimator/reset", Trigger.Request()).success


def thirds(events: list[Event]) -> tuple[list[Event], list[Event], list[Event]]:
    """Three parts of equal duration."""
    start, third = events[0][1], (events[-1][1] + STEP_NS - events[0][1]) // 3
    first, middle, last = (
        [event for event in events if (event[1] - start) // third == part] for part in range(3)
    )
    return first, middle, last


def inputs(seconds: float = SECONDS) -> list[Event]:
    return list(drive_messages(message_types.make, seconds))


@pytest.fixture
def estimator(start: Starter) -> Process:
    process = start("terrain_estimator", "estimator")
    process.wait_for_output("ready")
    return process


@pytest.fixture
def rover(listener: Listener, estimator: Process) -> Rover:
    return Rover(listener, estimator)


def assert_sound(messages: list[Any]) -> None:
    """Every published number is."""
    assert [text for message in messages for text in unsound(message)] == []


def test_it_estimates_and_predicts_once_for_each_complete_set(
    rover: Rover, listener: Listener, estimator: Process
) -> None:
    events = inputs()
    estimates = rover.drive(events)
    stamps = sorted({stamp for _, stamp, _ in events})
    assert [
        each.header.stamp.sec * 10**9 + each.header.stamp.nanosec for each in estimates
    ] == stamps
    assert [each.sequence for each in estimates] == list(range(len(stamps)))
    assert {each.decision.outcome_name for each in estimates} == {"ACCEPTED"}
    assert estimates[-1].cohesion_stddev < estimates[0].cohesion_stddev
    assert_sound(estimates)
    listener.wait_for_messages(rover.predictions, len(stamps))
    assert [each.sequence for each in rover.predictions] == list(range(len(stamps)))
    assert rover.predictions[-1].valid
    assert abs(rover.predictions[-1].innovation) < 6.0 * math.sqrt(
        rover.predictions[-1].innovation_variance
    )
    assert estimator.interrupt() == 0


def test_its_health_counts_every_message(rover: Rover, listener: Listener) -> None:
    rover.drive(inputs(2.0))
    total = rover.counted(20)
    assert dict(zip(total.input_topic, total.input_received, strict=True)) == dict.fromkeys(
        INPUT_TYPES, 20
    )
    assert sum(total.input_unpaired) == sum(total.input_out_of_order) == sum(total.input_lost) == 0
    assert 0.0 < total.update_latency_median <= total.update_latency_max
    listener.spin_until(
        lambda: rover.health[-1].level == EstimatorHealth.STALE, "silence is reported"
    )
    assert "wheel_slip" in rover.health[-1].summary


def test_without_input_it_reports_that_it_is_stale(listener: Listener, estimator: Process) -> None:
    health = listener.collect(EstimatorHealth, "estimator_health")
    listener.wait_for_messages(health, 2)
    assert {each.level for each in health} == {EstimatorHealth.STALE}
    assert math.isnan(health[0].input_age[0])
    assert estimator.running


def spoiled(events: list[Event], topic: str, field: str, value: Any) -> list[Event]:
    """Return the events with one field of one topic set in every message."""
    for name, _, message in events:
        if name == topic:
            owner: Any = message
            *path, last = field.split(".")
            for part in path:
                owner = getattr(owner, part)
            setattr(owner, last, value)
    return events


BAD_INPUT = [
    ("wheel_slip", "slip", [math.nan] * 6, Outcome.NOT_FINITE),
    ("wheel_slip", "slip", [math.inf] * 6, Outcome.NOT_FINITE),
    ("wheel_slip", "slip", [1e300] * 6, Outcome.OUT_OF_RANGE),
    ("wheel_slip", "slip", [3.0] * 6, Outcome.OUT_OF_RANGE),
    ("wheel_slip", "slip_stddev", [0.0] * 6, Outcome.BAD_DEVIATION),
    ("wheel_slip", "wheel", ["a", "b", "c", "d", "e", "f"], Outcome.WRONG_WHEELS),
    ("wheel_slip", "slip", [0.1, 0.2], Outcome.WRONG_WHEELS),
    ("wheel_slip", "header.frame_id", "map", Outcome.WRONG_FRAME),
    ("wheel_sinkage", "sinkage", [-0.05] * 6, Outcome.OUT_OF_RANGE),
    ("wheel_sinkage", "sinkage", [0.2] * 6, Outcome.OUT_OF_RANGE),
    ("wheel_sinkage", "wheel", [], Outcome.WRONG_WHEELS),
    ("odom", "twist.twist.linear.x", math.nan, Outcome.NOT_FINITE),
    ("odom", "twist.covariance", np.zeros(36), Outcome.BAD_DEVIATION),
    ("imu", "orientation.w", 0.0, Outcome.NOT_FINITE),
    ("joint_states", "velocity", [0.0] * len(JOINTS), Outcome.STANDSTILL),
]


def test_bad_input_is_a_counted_refusal_and_good_input_is_taken_after_it(
    rover: Rover, estimator: Process
) -> None:
    for number, (topic, field, value, outcome) in enumerate(BAD_INPUT, start=1):
        first, bad, rest = thirds(inputs(3.0))
        known = rover.drive(first)[-1]
        refused = rover.drive(spoiled(bad, topic, field, value))
        assert {each.decision.outcome_name for each in refused} == {outcome.name}, (
            topic,
            field,
            value,
        )
        assert {(each.cohesion, each.observations_used) for each in refused} == {
            (known.cohesion, known.observations_used)
        }
        assert outcome is Outcome.STANDSTILL or outcome.name in refused[-1].status_text
        last = rover.drive(rest)
        assert last[-1].decision.outcome_name == "ACCEPTED"
        assert_sound([*refused, *last])
        assert sum(rover.counted(20 * number).outcome_count) == 30 * number
        rover.reset()
    counts = dict(zip(rover.health[-1].outcome, rover.health[-1].outcome_count, strict=True))
    refusals = Counter(outcome.name for *_, outcome in BAD_INPUT)
    assert {name: count for name, count in counts.items() if name in refusals} == {
        name: 10 * count for name, count in refusals.items()
    }
    assert estimator.terminate() == 0


ABSURD_INPUT = [
    ("joint_states", "effort", [1e300] * len(JOINTS)),
    ("joint_states", "effort", [math.inf] * len(JOINTS)),
    ("joint_states", "velocity", [1e300] * len(JOINTS)),
    ("odom", "twist.twist.linear.x", 1e300),
    ("odom", "twist.covariance", np.full(36, 1e-320)),
    ("odom", "twist.covariance", np.full(36, 1e300)),
    ("imu", "linear_acceleration.x", -1e300),
    ("imu", "linear_acceleration.x", math.nan),
    ("wheel_slip", "slip_stddev", [1e-320] * 6),
    ("wheel_slip", "slip_stddev", [1e300] * 6),
    ("wheel_sinkage", "contact_angle", [1e300] * 6),
    ("wheel_sinkage", "sinkage_stddev", [1e-320] * 6),
]


def test_absurd_numbers_never_make_an_output_unsound(rover: Rover, estimator: Process) -> None:
    for topic, field, value in ABSURD_INPUT:
        first, bad, rest = thirds(inputs(3.0))
        rover.drive(first)
        assert_sound(rover.drive(spoiled(bad, topic, field, value)))
        assert_sound(rover.drive(rest))
        rover.reset()
    assert "in a callback" not in estimator.output


def test_without_torque_and_imu_it_estimates_with_fewer_rows_and_says_so(rover: Rover) -> None:
    events = [event for event in inputs() if event[0] not in {"joint_states", "imu"}]
    estimates = rover.drive(events, waiting=5)  # the last 0.5 s still wait for the missing topics
    assert {each.decision.outcome_name for each in estimates} == {"ACCEPTED"}
    assert set(estimates[-1].rows) == {"velocity", "load"}
    assert estimates[-1].status == TerrainEstimate.DEGRADED
    assert "rows missing: torque_0" in estimates[-1].status_text
    assert_sound(estimates)


def test_without_a_sinkage_sensor_it_estimates_from_torques_and_balances(
    start: Starter, listener: Listener
) -> None:
    process = start("terrain_estimator", "estimator", "--ros-args", "-p", "use_sinkage:=false")
    process.wait_for_output("ready")
    rover, events = Rover(listener, process), inputs()
    for topic, _, message in events:
        if topic == "wheel_sinkage":
            message.sinkage = [math.nan] * len(message.wheel)
            message.sinkage_stddev = [math.nan] * len(message.wheel)
    estimates = rover.drive(events)
    assert {each.decision.outcome_name for each in estimates} == {"ACCEPTED"}
    assert "load" not in estimates[-1].rows
    assert "torque_0" in estimates[-1].rows
    assert "rows missing" not in estimates[-1].status_text
    assert estimates[-1].cohesion_stddev < estimates[0].cohesion_stddev
    assert_sound(estimates)


def test_with_a_model_of_the_velocity_alone_it_uses_no_other_row_and_identifies_nothing(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    path, rover, soil = tmp_path / "velocity.pt", load_rover("mars_rover"), load_soil("loose_sand")
    model = build_model(rover, [soil], used_rows=VELOCITY_ALONE)
    export(model, rover, [soil], Training(0, 0, 0.0, torch.__version__), path)
    process = start("terrain_estimator", "estimator", "--ros-args", "-p", f"model:={path}")
    process.wait_for_output("ready")
    estimates = Rover(listener, process).drive(inputs())
    assert {each.decision.outcome_name for each in estimates} == {"ACCEPTED"}
    assert list(estimates[-1].rows) == ["velocity"]
    assert estimates[-1].status == TerrainEstimate.CONVERGING
    assert "rows missing" not in estimates[-1].status_text
    assert estimates[-1].cohesion_stddev < estimates[0].cohesion_stddev
    assert_sound(estimates)


POOR = ["-p", "default_sd.velocity:=5.0", "-p", "default_sd.pitch:=1.0", "-p", "use_torque:=false"]
POOR += ["-p", "use_moments:=false", "-p", "use_imu:=false", "-p", "model:=paper_rover"]


def test_sensors_that_leave_the_ground_to_the_prior_keep_it_from_being_configured(
    start: Starter,
) -> None:
    process = start("terrain_estimator", "estimator", "--ros-args", *POOR)
    process.wait_for_output("these sensors leave the ground to the prior")
    assert "on compact_sand" in process.output
    assert "use_torque: false" in process.output
    assert "default_sd.velocity: 5" in process.output
    assert "ready" not in process.output


def test_a_reset_brings_the_prior_back_and_lets_time_start_again(
    rover: Rover, listener: Listener
) -> None:
    events = inputs(2.0)
    first = rover.drive(events)
    assert rover.drive(events[-25:], waiting=5) == []  # stamps of before are not taken
    listener.spin_until(
        lambda: rover.health and sum(rover.health[-1].input_out_of_order) == 25,
        "all of them came before the reset",
    )
    rover.reset()
    again = rover.drive(events)
    assert [each.cohesion for each in again] == [each.cohesion for each in first]
    assert again[0].sequence == len(first)
    listener.spin_until(
        lambda: rover.health and rover.health[-1].resets == 1, "the reset is counted"
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_a_signal_ends_it_with_success(estimator: Process, number: signal.Signals) -> None:
    estimator.signal(number)
    assert estimator.wait() == 0
    assert "Traceback" not in estimator.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-p", "modell:=x"], ["modell", "did you mean model"]),
        (["-p", "pairing_timeout:=-1.0"], ["pairing_timeout", "at least 0 and at most 60 [s]"]),
        (["-p", "use_imu:=3"], ["use_imu", "true or false"]),
        (["-p", "prior.cohesion_mean:=1000.0"], ["prior.cohesion_sd"]),
    ],
)
def test_a_wrong_parameter_is_named_and_ends_it_at_once(
    start: Starter, arguments: list[str], words: list[str]
) -> None:
    process = start("terrain_estimator", "estimator", "--ros-args", *arguments)
    assert process.wait() == 2
    assert all(word in process.output for word in words), process.output
    assert "Traceback" not in process.output


def test_an_unknown_key_of_a_parameter_file_is_named(start: Starter, tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("estimator: {ros__parameters: {prior: {cohesion_average: 1000.0}}}\n")
    process = start("terrain_estimator", "estimator", "--ros-args", "--params-file", str(path))
    assert process.wait() == 2
    assert "prior.cohesion_average" in process.output


def test_a_parameter_file_that_is_for_no_such_node_is_named(start: Starter, tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("estimatr: {ros__parameters: {use_imu: false}}\n")
    process = start("terrain_estimator", "estimator", "--ros-args", "--params-file", str(path))
    assert process.wait() == 2
    assert "p.yaml: no section is for the node /estimator" in process.output
    assert "did you mean /estimatr?" in process.output


def test_the_dumped_configuration_is_a_parameter_file_that_gives_the_same_again(
    start: Starter, tmp_path: Path
) -> None:
    path = tmp_path / "p.yaml"
    first = start(
        "terrain_estimator",
        "estimator",
        "--dump-config",
        "--ros-args",
        "-r",
        "__ns:=/a",
        "-p",
        "prior.soil:=regolith",
    )
    assert first.wait() == 0
    path.write_text(first.output)
    second = start(
        "terrain_estimator",
        "estimator",
        "--dump-config",
        "--ros-args",
        "-r",
        "__ns:=/a",
        "--params-file",
        str(path),
    )
    assert second.wait() == 0
    assert second.output == first.output
    assert "prior.soil: regolith" in first.output


def test_an_unknown_argument_is_named(start: Starter) -> None:
    process = start("terrain_estimator", "estimator", "--modle", "x")
    assert process.wait() == 2
    assert "--modle" in process.output


def test_parameters_are_described_and_cannot_be_changed_later(
    start: Starter, listener: Listener
) -> None:
    process = start("terrain_estimator", "estimator")
    process.wait_for_output("ready")
    described = listener.call(
        DescribeParameters,
        "estimator/describe_parameters",
        DescribeParameters.Request(names=["pairing_timeout"]),
    )
    assert "[s]" in described.descriptors[0].description
    assert described.descriptors[0].floating_point_range[0].to_value == 60.0
    change = SetParameters.Request(
        parameters=[Parameter("use_imu", value=False).to_parameter_msg()]
    )
    assert (
        not listener.call(SetParameters, "estimator/set_parameters", change).results[0].successful
    )
    wait_until(lambda: process.running, "it still runs")
