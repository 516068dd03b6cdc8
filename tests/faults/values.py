# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of values: one sensor publishes wrong ones for eight seconds."""

import math
from collections.abc import Callable
from typing import Any

from tests.drives import Event
from tests.faults.fault import Expected, Fault
from tests.faults.rover import Change, Rover
from tests.faults.through import of_estimator
from tests.system.processes import Process

FAULT_S = 8.0
"""[s] Duration of a fault; five seconds until the log, one or two until some faults take effect."""
WHEELS = 6


def said(topic: str, set_to: Callable[[Any], None]) -> Change:
    """Change the messages of one topic."""

    def change(events: list[Event]) -> list[Event]:
        for name, _, message in events:
            if name == topic:
                set_to(message)
        return events

    return change


def spoilt(name: str, what: str, change: Change, expected: Expected) -> Fault:
    """Return a row in which every message of eight seconds is changed."""

    def happen(rover: Rover, _: Process) -> None:
        rover.drive(FAULT_S, change, sound=False)

    return of_estimator(name, what, happen, expected)


def refused(outcome: str) -> Expected:
    """Expect that every observation is refused for this reason, and nothing else."""
    return Expected(
        frozenset({outcome}), {"refused": "ERROR"}, log=(rf"^refused: [0-9]+ {outcome} ",)
    )


def _nan(message: Any) -> None:
    message.slip = [math.nan] * WHEELS


def _infinite(message: Any) -> None:
    message.twist.twist.linear.x = math.inf


def _huge(message: Any) -> None:
    message.twist.twist.linear.x = 1e308


def _huge_torque(message: Any) -> None:
    message.effort = [1e308] * len(message.name)


def _negative(message: Any) -> None:
    message.twist.covariance[0] = -1e-4


def _five_wheels(message: Any) -> None:
    message.wheel, message.slip, message.slip_stddev = (
        message.wheel[:-1],
        message.slip[:-1],
        message.slip_stddev[:-1],
    )


def _frame(message: Any) -> None:
    message.header.frame_id = "map"


def _stuck() -> Change:
    """Repeat the first velocity."""
    kept: list[float] = []

    def hold(message: Any) -> None:
        kept.append(message.twist.twist.linear.x)
        message.twist.twist.linear.x = kept[0]

    return said("odom", hold)


TAKEN = Expected(frozenset({"ACCEPTED"}), {})
PARTLY_TAKEN = Expected(frozenset({"ACCEPTED_PARTIALLY"}), {})
FAULTS = (
    spoilt("NaN", "wheel_slip: every slip is NaN", said("wheel_slip", _nan), refused("NOT_FINITE")),
    spoilt("inf", "odom: the velocity is infinite", said("odom", _infinite), refused("NOT_FINITE")),
    spoilt(
        "1e308", "odom: the velocity is 1e308 m/s", said("odom", _huge), refused("OUT_OF_RANGE")
    ),
    spoilt(
        "1e308, optional",
        "joint_states: every torque is 1e308 N m",
        said("joint_states", _huge_torque),
        PARTLY_TAKEN,
    ),
    spoilt(
        "negative variance",
        "odom: the variance of the velocity is -1e-4",
        said("odom", _negative),
        refused("BAD_DEVIATION"),
    ),
    spoilt("stuck sensor", "odom: the velocity stays as it was", _stuck(), TAKEN),
    spoilt(
        "wrong wheel count",
        "wheel_slip: the last wheel is missing",
        said("wheel_slip", _five_wheels),
        refused("WRONG_WHEELS"),
    ),
    spoilt(
        "wrong frame",
        "wheel_slip: frame_id is map",
        said("wheel_slip", _frame),
        refused("WRONG_FRAME"),
    ),
)
