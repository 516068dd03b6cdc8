# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of stamps and of the order of messages."""

from tests.drives import Event
from tests.faults.fault import Expected
from tests.faults.rover import Change, Rover, shifted
from tests.faults.through import Happen, of_estimator
from tests.faults.values import FAULT_S, TAKEN
from tests.system.processes import Process

SECOND_NS = 10**9
TOPICS = ("wheel_slip", "wheel_sinkage", "odom", "joint_states", "imu")
FIVE_A_SECOND = frozenset({"innovation"})
"""Line of a check on few squared innovations, which fails in 1 % of all seconds."""
OUT_OF_ORDER = tuple(rf"^{topic}: .*[0-9]+ out of order" for topic in TOPICS)


def _at_zero(events: list[Event]) -> list[Event]:
    return shifted(events, -events[0][1])


def _driven(change: Change, *, sound: bool = True) -> Happen:
    def happen(rover: Rover, _: Process) -> None:
        rover.drive(FAULT_S, change, sound=sound)

    return happen


def _jump(by_ns: int) -> Happen:
    """Set the clock at one instant, and keep it so."""

    def happen(rover: Rover, _: Process) -> None:
        rover.shift_ns = by_ns
        rover.end_fault()
        rover.drive(FAULT_S)

    return happen


def _swap(rover: Rover, _: Process) -> None:
    for _pair in range(round(FAULT_S * 5.0)):
        first, second = rover.next_instant(), rover.next_instant()
        rover.publish(second)
        rover.publish(first)


def _wait(rover: Rover, _: Process) -> None:
    rover.wait(60.0)
    rover.shift_ns = 60 * SECOND_NS
    rover.end_fault()


FAULTS = (
    of_estimator(
        "zero stamp",
        "all topics: the stamp is 0",
        _driven(_at_zero, sound=False),
        Expected(frozenset({"none"}), {"losses": "WARN"}, log=OUT_OF_ORDER),
    ),
    of_estimator(
        "backward jump",
        "all topics: the stamps go back by 60 s, and on from there",
        _jump(-60 * SECOND_NS),
        Expected(
            frozenset({"none", "ACCEPTED"}),
            {"losses": "WARN"},
            log=(
                (
                    "^the clock went back by 59.0 s, as when a bag loops: the posterior is the"
                    " prior again$"
                ),
            ),
            back_after=9,
            lost=9,
            kept=False,
        ),
    ),
    of_estimator(
        "forward jump",
        "all topics: the stamps go forward by an hour, and on from there",
        _jump(3600 * SECOND_NS),
        TAKEN,
    ),
    of_estimator(
        "duplicate",
        "all topics: every message comes twice",
        _driven(lambda events: [*events, *events]),
        Expected(frozenset({"ACCEPTED"}), {"losses": "WARN"}, log=OUT_OF_ORDER),
    ),
    of_estimator(
        "reorder",
        "all topics: every second instant comes after the one that follows it",
        _swap,
        Expected(
            frozenset({"ACCEPTED", "none"}),
            {"losses": "WARN"},
            FIVE_A_SECOND,
            log=OUT_OF_ORDER,
            lost=40,
        ),
    ),
    of_estimator(
        "reorder, topics",
        "the topics of an instant come in reverse order",
        _driven(lambda events: events[::-1]),
        TAKEN,
    ),
    of_estimator(
        "1 min gap",
        "all topics: no message for a minute, then on",
        _wait,
        Expected(
            frozenset(),
            {"optional input": "WARN", "required input": "STALE"},
            log=tuple(rf"^no data on {topic} for [0-9.]+ s" for topic in TOPICS),
        ),
    ),
)
