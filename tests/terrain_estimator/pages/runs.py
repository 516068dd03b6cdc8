# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Runs as replay passes them to its report, with invented numbers."""

import dataclasses
import math
from functools import cache

from terrain_estimator.messaging.history import RunHistory, WheelHistory
from terrain_estimator.messaging.pairing import Counters
from terrain_estimator.outcome import Outcome
from terrain_estimator.pages.run import Origin, ReplayedRun, ShownTruth, run_page
from tests.terrain_estimator.updates import START_NS, STEP_NS, update

OBSERVATIONS = 1000
ORIGIN = Origin(
    rover="mars_rover",
    identity=[("model", "mars_rover-7"), ("model, SHA-256", "ab" * 32)],
    parameters=[
        ("use_imu", "true", "true", "use pitch and acceleration"),
        ("prior.soil", "regolith", "", "name of the soil"),
    ],
    citations=["A. Author: A law of sand. 1967."],
)


def run(observations: int = OBSERVATIONS, *, true: bool = True) -> ReplayedRun:
    """Return a run whose ground changes in its middle, with a second of refused observations."""
    history = RunHistory()
    for number in range(observations):
        refused = 500 <= number < 510
        history.add(
            update(
                number,
                Outcome.GATED if refused else Outcome.ACCEPTED,
                change=0.97 if refused else 0.01,
            )
        )
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    slip, sinkage = WheelHistory(wheels), WheelHistory(wheels)
    for number in range(observations):
        share = number / OBSERVATIONS
        slip.add(
            START_NS + number * STEP_NS,
            wheels,
            [share - 0.1, share, math.nan if number < OBSERVATIONS // 2 else 0.4, 0.2],
        )
        sinkage.add(START_NS + number * STEP_NS, wheels, [0.01 + 0.02 * share, 0.012, 0.015, 0.016])
    truths = [
        ShownTruth(START_NS - STEP_NS, (830.0, 0.61), "loose_sand"),
        ShownTruth(
            START_NS + 500 * STEP_NS, (1800.0, 0.65), "compact_sand with drive_drag 0.2 N m s/rad"
        ),
    ]
    return ReplayedRun(
        name="dune",
        bag="bags/dune",
        bag_sha256="cd" * 32,
        state_sha256="ef" * 32,
        span_s=0.1 * max(observations - 1, 0),
        status="converging" if observations else "",
        status_text="converging; not identified yet: cohesion" if observations else "",
        disagreements=[],
        remarks=["dune: 10 x GATED: a sensor failed"],
        history=history,
        slip=slip,
        sinkage=sinkage,
        truths=truths if true else [],
        inputs={"wheel_slip": Counters(received=observations, lost=3)},
    )


@cache
def one() -> str:
    """Return the page about one run."""
    return run_page([run()], ORIGIN)


@cache
def report() -> str:
    """Return the page about two runs, one of them without truth."""
    return run_page([run(), dataclasses.replace(run(12, true=False), name="rock")], ORIGIN)
