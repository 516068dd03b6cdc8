# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every parameter has an effect: on a drive here, or in a test that is named here."""

import ast
import copy
import math
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from docs.pages import NODES
from rover_parameters.parameters import configure, parameters
from rover_sim_node.config import SimulatorConfig
from rover_sim_node.messages import step_messages
from rover_sim_node.reading import SimulatedReading
from rover_sim_node.run import SimulatedRun
from rover_sim_node.turning_run import TurningRun
from rover_sim_node.velocity_commands import VelocityCommands
from terrain_estimator.bags import BagWriter, Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.config.recorder import RecorderConfig
from terrain_estimator.messaging.pipeline import Answer, Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.outcome import Outcome
from terramechanics.presets import PRESETS, load_rover
from tests.drives import Event, drive_messages
from tests.parameters_tested_elsewhere import ELSEWHERE

TESTS = Path(__file__).parent
OFF, ON = False, True
cached_model: Callable[[str], LoadedModel] = cache(load_model)


def spoiled(events: list[Event], topic: str, **values: Any) -> list[Event]:
    """Set fields of one topic in every message; a double underscore stands for the dot."""
    for name, _, message in events:
        for path, value in values.items() if name == topic else ():
            *owners, last = path.split("__")
            owner = message
            for word in owners:
                owner = getattr(owner, word)
            setattr(owner, last, value)
    return events


def without(topic: str) -> Callable[[list[Event]], list[Event]]:
    return lambda events: [event for event in events if event[0] != topic]


def late_odometry(events: list[Event]) -> list[Event]:
    for name, _, message in events:
        if name == "odom":
            message.header.stamp = copy.deepcopy(message.header.stamp)  # all topics share it
            message.header.stamp.nanosec += 10_000_000
    return events


def same(events: list[Event]) -> list[Event]:
    return events


def answers(
    values: dict[str, Any], change: Callable[[list[Event]], list[Event]], seconds: float = 2.0
) -> list[Answer]:
    """Return the estimator's answers to a drive in which some messages still wait at the end."""
    config = configure(EstimatorConfig, values)
    pipeline = Pipeline(cached_model(config.model), config)
    events = change(list(drive_messages(Types().make, seconds)))
    return [
        answer
        for topic, _, message in events
        if topic in pipeline.inputs
        for answer in pipeline.add(topic, message)
    ]


def rows(given: list[Answer]) -> set[str]:
    return {row for answer in given for row in answer.update.decision.rows_used}


def outcomes(given: list[Answer]) -> set[Outcome]:
    return {answer.update.decision.outcome for answer in given}


def mean(given: list[Answer]) -> list[float]:
    return [float(value) for value in given[-1].update.estimate.mean]


def sd(given: list[Answer]) -> list[float]:
    return [math.sqrt(value) for value in np.diagonal(given[-1].update.estimate.covariance)]


class Case(NamedTuple):
    """A value, the parameters that it needs, and what has to differ."""

    value: Any
    differs: Callable[[list[Answer], list[Answer]], bool]  # (with the default, with the value)
    beside: dict[str, Any] = {}  # noqa: RUF012 - never written to
    change: Callable[[list[Event]], list[Event]] = same
    seconds: float = 2.0


def no_variance(topic: str, *fields: str) -> Callable[[list[Event]], list[Event]]:
    sizes = {"orientation_covariance": 9, "linear_acceleration_covariance": 9}
    return lambda events: spoiled(
        events, topic, **{name: np.zeros(sizes.get(name, 36)) for name in fields}
    )


def no_pitch_variance(events: list[Event]) -> list[Event]:
    return no_variance("odom", "pose__covariance")(
        no_variance("imu", "orientation_covariance")(events)
    )


ESTIMATOR = {
    "model": Case("paper_rover", lambda a, b: outcomes(a) != outcomes(b)),
    "use_torque": Case(OFF, lambda a, b: "torque_0" in rows(a) - rows(b)),
    "use_imu": Case(OFF, lambda a, b: "acceleration" in rows(a) - rows(b)),
    "use_sinkage": Case(OFF, lambda a, b: "load" in rows(a) - rows(b)),
    "contact_angle_sd": Case(
        0.03,
        lambda a, b: Outcome.ACCEPTED in outcomes(b) - outcomes(a),
        change=lambda events: spoiled(events, "wheel_sinkage", contact_angle=np.full(6, np.nan)),
    ),
    "use_moments": Case(OFF, lambda a, b: "moment" in rows(a) - rows(b)),
    "prior.cohesion_mean": Case(
        3000.0,
        lambda a, b: mean(b)[0] > 2900.0 > mean(a)[0],
        {"prior.cohesion_mean": 1500.0, "prior.cohesion_sd": 10.0},
    ),
    "prior.cohesion_sd": Case(
        10.0,
        lambda a, b: sd(b)[0] <= 10.0 < sd(a)[0],
        {"prior.cohesion_mean": 1500.0, "prior.cohesion_sd": 900.0},
    ),
    "prior.tan_phi_mean": Case(
        0.9,
        lambda a, b: mean(b)[1] > 0.85 > mean(a)[1],
        {"prior.tan_phi_mean": 0.6, "prior.tan_phi_sd": 0.01},
    ),
    "prior.tan_phi_sd": Case(
        0.001,
        lambda a, b: sd(b)[1] <= 0.001 < sd(a)[1],
        {"prior.tan_phi_mean": 0.6, "prior.tan_phi_sd": 0.2},
    ),
    "prior.soil": Case(
        "regolith",
        lambda a, b: (
            b[-1].update.estimate.soil_probability[2] > a[-1].update.estimate.soil_probability[2]
        ),
    ),
    "forgetting_time": Case(4.0, lambda a, b: sd(b)[0] > sd(a)[0]),
    "standstill_speed": Case(1.0, lambda a, b: outcomes(b) == {Outcome.STANDSTILL} != outcomes(a)),
    "gate_probability": Case(
        0.1, lambda a, b: Outcome.GATED in outcomes(b) - outcomes(a), seconds=6.0
    ),
    "slip_minimum": Case(
        0.0,
        lambda a, b: outcomes(b) == {Outcome.OUT_OF_RANGE} != outcomes(a),
        change=lambda e: spoiled(e, "wheel_slip", slip=np.full(6, -0.1)),
    ),
    "slip_maximum": Case(
        0.4,
        lambda a, b: outcomes(b) == {Outcome.OUT_OF_RANGE} != outcomes(a),
        change=lambda e: spoiled(e, "wheel_slip", slip=np.full(6, 0.5)),
    ),
    "roll_limit": Case(
        0.2,
        lambda a, b: (outcomes(a), outcomes(b)) == ({Outcome.NOT_PLANAR}, {Outcome.ACCEPTED}),
        change=lambda e: spoiled(
            spoiled(e, "odom", pose__pose__orientation__x=0.04), "imu", orientation__x=0.04
        ),
    ),
    "turn_limit": Case(
        0.5,
        lambda a, b: (outcomes(a), outcomes(b)) == ({Outcome.NOT_PLANAR}, {Outcome.ACCEPTED}),
        change=lambda e: spoiled(e, "odom", twist__twist__linear__y=0.05),
    ),
    "default_sd.lateral_velocity": Case(
        0.05,
        lambda a, b: (outcomes(a), outcomes(b)) == ({Outcome.NOT_PLANAR}, {Outcome.ACCEPTED}),
        change=lambda e: spoiled(e, "odom", twist__twist__linear__y=0.05),
    ),
    "default_sd.yaw_rate": Case(
        0.05,
        lambda a, b: (outcomes(a), outcomes(b)) == ({Outcome.NOT_PLANAR}, {Outcome.ACCEPTED}),
        change=lambda e: spoiled(
            spoiled(e, "odom", twist__twist__angular__z=0.1), "imu", angular_velocity__z=0.1
        ),
    ),
    "body_frame": Case("chassis", lambda a, b: outcomes(b) == {Outcome.WRONG_FRAME} != outcomes(a)),
    "torque_noise.relative": Case(0.5, lambda a, b: sd(b)[1] > sd(a)[1]),
    "torque_noise.absolute": Case(100.0, lambda a, b: sd(b)[1] > sd(a)[1]),
    "bogie_joint": Case("left_bogie", lambda a, b: "moment" in rows(a) - rows(b)),
    "bogie_nose_down": Case(ON, lambda a, b: mean(a) != mean(b)),
    "default_sd.velocity": Case(
        0.01,
        lambda a, b: (outcomes(a), outcomes(b)) == ({Outcome.BAD_DEVIATION}, {Outcome.ACCEPTED}),
        change=no_variance("odom", "twist__covariance"),
    ),
    "default_sd.pitch": Case(
        0.01,
        lambda a, b: (outcomes(a), outcomes(b)) == ({Outcome.BAD_DEVIATION}, {Outcome.ACCEPTED}),
        change=no_pitch_variance,
    ),
    "default_sd.acceleration": Case(
        0.02,
        lambda a, b: "acceleration" in rows(b) - rows(a),
        change=no_variance("imu", "linear_acceleration_covariance"),
    ),
    "pairing_tolerance": Case(0.02, lambda a, b: len(b) > len(a) == 0, change=late_odometry),
    "pairing_timeout": Case(0.1, lambda a, b: len(b) == len(a) + 4, change=without("imu")),
}


@pytest.mark.parametrize("name", ESTIMATOR)
def test_a_parameter_of_the_estimator_changes_what_it_says(name: str) -> None:
    case = ESTIMATOR[name]
    plain, changed = (
        answers(case.beside | given, case.change, case.seconds)
        for given in ({}, {name: case.value})
    )
    assert case.differs(plain, changed)


def test_the_rover_file_names_the_wheels(tmp_path: Path) -> None:
    path = tmp_path / "rover.yaml"
    path.write_text(
        (PRESETS / "rovers/mars_rover.yaml").read_text().replace("front_left", "bow_port")
    )
    assert outcomes(answers({"rover": str(path)}, same, 0.5)) == {Outcome.WRONG_WHEELS}


def readings(values: dict[str, Any], steps: int) -> tuple[SimulatorConfig, list[SimulatedReading]]:
    config = configure(SimulatorConfig, values)
    run = TurningRun(config) if config.steering else SimulatedRun(config)
    if config.steering:
        assert run.commands is not None
        assert run.commands.request((0.05, 0.0, 0.0), (0.0, 0.0, 0.1)) == ""
    return config, [run.step() for _ in range(steps)]


def sensed(values: dict[str, Any]) -> str:
    """Return everything that a short drive publishes, and the truth, as text."""
    config, read = readings({"noise": 0.0} | values, 20 if "profile" in values else 3)
    return str(
        [
            (reading.truth, step_messages(reading, config, round(reading.time * 1e9), n))
            for n, reading in enumerate(read)
        ]
    )


SOIL = {
    "n": 1.0,
    "k_c": 1000.0,
    "k_phi": 1.4e6,
    "shear_modulus": 0.03,
    "c1": 0.2,
    "c2": 0.3,
    "cohesion": 1200.0,
    "tan_phi": 0.5,
}
TURNING = {"steering": "skid", "schedule": "cmd_vel"}
SIMULATOR: dict[str, tuple[Any, dict[str, Any]]] = {
    "rover": ("paper_rover", {}),
    "soil": ("compact_sand", {}),
    **{f"soil_overrides.{name}": (value, {}) for name, value in SOIL.items()},
    "change.soil": ("compact_sand", {"change.position": 0.0}),
    "change.position": (0.0, {"change.soil": "compact_sand"}),
    "change.transition": (3.0, {"change.soil": "compact_sand", "change.position": 0.0}),
    "schedule": ("S3", {}),
    "profile": ("ramp", {}),
    "ramp_grade": (0.1, {"profile": "ramp", "rate": 1.0}),
    "step_rise": (0.1, {"profile": "step", "rate": 1.0}),
    "steering": ("all_wheels", TURNING),
    "cross_slope": (0.1, TURNING),
    "yaw_inertia": (100.0, TURNING),
    "effect": ("sinkage_bias", {"effect": "slope_bias", "effect_size": 0.004}),
    "effect_size": (0.004, {"effect": "sinkage_bias", "effect_size": 0.0}),
    "effect_axle": (0, {"effect": "failed_wheel", "effect_size": 0.5}),
    "noise": (1.0, {}),
    "sinkage_sensor": (OFF, {}),
    "sinkage_reference": ("local", {}),
    "contact_angle_sensor": (OFF, {}),
    "seed": (1, {}),
    "rate": (20.0, {}),
    "body_frame": ("chassis", {}),
    "odom_frame": ("track", {}),
}


@pytest.mark.parametrize("name", SIMULATOR)
def test_a_parameter_of_the_simulator_changes_what_is_sensed(name: str) -> None:
    value, beside = SIMULATOR[name]
    assert sensed(beside) != sensed(beside | {name: value})


COMMANDS = [("cmd_vel_timeout", 0.1), ("cmd_vel_acceleration", 0.1), ("cmd_vel_limit", 0.2)]


def followed(values: dict[str, Any], steps: int = 9) -> tuple[str, list[float]]:
    """Return the answer to a single velocity command, and the resulting wheel rates."""
    commands = VelocityCommands(load_rover("mars_rover"), configure(SimulatorConfig, values))
    refusal = commands.request((0.3, 0.0, 0.0), (0.0, 0.0, 0.0))
    return refusal, [float(commands.command(0.1 * step)[0, 0]) for step in range(steps)]


@pytest.mark.parametrize(("name", "value"), COMMANDS)
def test_a_parameter_of_velocity_commands_changes_how_they_are_followed(
    name: str, value: float
) -> None:
    assert followed({}) != followed({name: value})


def test_a_shorter_interval_syncs_the_recording_more_often(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []
    for given in ({}, {"fsync_interval": 0.01}):
        synced: list[int] = []
        monkeypatch.setattr("os.fsync", synced.append)
        with BagWriter(
            tmp_path / str(len(counts)),
            recording=True,
            sync_interval_s=configure(RecorderConfig, given).fsync_interval_s,
        ):
            before = len(synced)
            threading.Event().wait(0.3)
            counts.append(len(synced) - before)
    assert counts[0] == 0
    assert counts[1] > 5


def test_no_parameter_is_without_a_test() -> None:
    here = {f"estimator {name}" for name in ESTIMATOR} | {
        f"simulator {name}" for name in (*SIMULATOR, *(name for name, _ in COMMANDS))
    }
    assert here | set(ELSEWHERE) == {
        f"{node} {entry.name}" for node, config in NODES.items() for entry in parameters(config)
    }


@pytest.mark.parametrize(("parameter", "test"), ELSEWHERE.items(), ids=ELSEWHERE)
def test_the_test_that_is_named_uses_the_parameter(parameter: str, test: str) -> None:
    path, function = test.split("::")
    text = (TESTS / path).read_text(encoding="utf-8")
    [found] = [
        node
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef) and node.name == function
    ]
    assert parameter.split()[1] in (ast.get_source_segment(text, found) or "")
