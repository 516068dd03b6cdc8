# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Outcome of an observation: every case by name, with advice."""

from enum import IntEnum


class Outcome(IntEnum):
    """Outcome of one observation; the values are those of msg_defs/MeasurementDecision."""

    ACCEPTED = 0
    ACCEPTED_PARTIALLY = 1
    STANDSTILL = 2
    NOT_FINITE = 3
    BAD_DEVIATION = 4
    OUT_OF_RANGE = 5
    WRONG_WHEELS = 6
    WRONG_FRAME = 7
    TIME_BACKWARDS = 8
    DUPLICATE = 9
    GATED = 10
    NUMERICAL_FAILURE = 11
    NOT_PLANAR = 12

    @property
    def advice(self) -> str:
        """Advice to the user, in a sentence; empty where nothing is wrong."""
        return _ADVICE.get(self, "")

    @property
    def used(self) -> bool:
        """Return whether the observation was accepted, to enter the posterior with its second."""
        return self in (Outcome.ACCEPTED, Outcome.ACCEPTED_PARTIALLY)


_ADVICE = {
    Outcome.ACCEPTED_PARTIALLY: (
        "a wheel or a sensor was left out: check the wheels' slip and sinkage and the optional"
        " sensors"
    ),
    Outcome.STANDSTILL: "drive: slip is undefined while the wheels stand",
    Outcome.NOT_FINITE: "check the publisher of the value that is NaN or infinite",
    Outcome.BAD_DEVIATION: (
        "publish a standard deviation above zero with every measurement, in SI units"
    ),
    Outcome.OUT_OF_RANGE: (
        "check the units, slip (-0.6 to 0.95) and sinkage (0 to the wheel radius) of all wheels,"
        " and the rover file"
    ),
    Outcome.WRONG_WHEELS: "publish the wheel names of the rover file, each once",
    Outcome.WRONG_FRAME: (
        "publish in the body frame that the estimator's parameter body_frame names, and sinkage"
        " from undisturbed ground"
    ),
    Outcome.TIME_BACKWARDS: (
        "stamps must increase: check the clock, or reset the estimator when a bag loops"
    ),
    Outcome.DUPLICATE: (
        "two observations carry the same stamp: check for two publishers on one topic"
    ),
    Outcome.GATED: (
        "no ground that the model knows explains it: the model or the rover file is not of this"
        " rover, the ground changed, or a sensor failed"
    ),
    Outcome.NOT_PLANAR: (
        "the model drives straight up and down: only a model by wheel (model_by_wheel) learns in"
        " turns and across slopes; a rover that does neither has a wrong roll, yaw rate or lateral"
        " velocity, or too small a variance of them: correct it, or set roll_limit or turn_limit to"
        " 0"
    ),
    Outcome.NUMERICAL_FAILURE: "reset the estimator; if the failure recurs, report the recording",
}
