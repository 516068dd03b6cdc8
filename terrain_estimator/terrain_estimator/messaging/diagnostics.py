# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of a running node, with the limits for warnings and errors in one table.

A check takes a number and returns a result. docs/diagnostics.md is written from the checks,
/diagnostics and estimator_health from the results.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum

from terrain_estimator.config.estimator import COMPILED
from terrain_estimator.estimator.intake import ADVICE, LEAST_TAKEN
from terrain_estimator.estimator.sensor_information import LARGEST_BOUND


class Level(IntEnum):
    """Level of health.

    The values are those of msg_defs/EstimatorHealth and diagnostic_msgs/DiagnosticStatus.
    """

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Check:
    """One quantity and its limits.

    A level applies where the quantity is above the level's limit; infinity switches a level off.
    """

    name: str
    quantity: str
    unit: str
    advice: str
    warn: float = math.inf
    error: float = math.inf
    stale: float = math.inf

    def judge(self, value: float, subject: str = "", text: str = "") -> "CheckResult":
        """Judge one value; NaN stands for an unknown value and is no fault.

        Args:
            value: in ``unit``.
            subject: topic or other object that the value belongs to, where there are several.
            text: the result in words; by default the quantity and the value.
        """
        limits = ((Level.STALE, self.stale), (Level.ERROR, self.error), (Level.WARN, self.warn))
        level = next((level for level, limit in limits if value > limit), Level.OK)
        unit = "" if self.unit == "1" else f" {self.unit}"
        return CheckResult(
            self, subject, value, level, text or f"{self.quantity} is {value:.3g}{unit}".rstrip()
        )


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Level of one value."""

    check: Check
    subject: str
    value: float
    level: Level
    text: str
    details: tuple[tuple[str, str], ...] = ()
    """Keys and values that /diagnostics has beside ``value`` and ``unit``."""

    @property
    def name(self) -> str:
        """Name of the check, with its subject."""
        return f"{self.check.name} {self.subject}".rstrip()

    @property
    def message(self) -> str:
        """Result in words, with advice where something is wrong."""
        return (
            f"{self.text} ({self.check.advice})" if self.level and self.check.advice else self.text
        )


STATE = Check(
    "lifecycle",
    "state of the node: 0 active, 1 inactive, 2 configuration failed",
    "",
    "activate it, or read its log",
    0.0,
    1.0,
)
CLOCK = Check(
    "clock",
    "time without progress of /clock under use_sim_time, checked once a second",
    "s",
    "start the simulator or a player that publishes /clock, or set use_sim_time to false; /clock"
    " also stops while a simulation is paused",
    1.5,
    5.0,
)
PUBLISHERS = Check(
    "publishers",
    "publishers of an input with another type or an incompatible quality of service",
    "",
    "see docs/messages.md",
    error=0.0,
)
REQUIRED = Check(
    "required input",
    "time without a message, by the steady clock",
    "s",
    "check its publisher and the topic name",
    stale=1.0,
)
OPTIONAL = Check(
    "optional input",
    "time without a message after the first, by the steady clock",
    "s",
    "its rows are missing: check its publisher",
    1.0,
)
LOSSES = Check(
    "losses",
    "messages since the last report that were lost, out of order or, on a required topic where"
    " an instant was incomplete, without a partner",
    "",
    "check stamps, load and network",
    0.0,
)
RATE = Check(
    "rate",
    "1 where the readings come at a rate that cannot be used; the text has the rate",
    "",
    "publish wheel_slip, wheel_sinkage and odom at 5 to 200 Hz",
    error=0.0,
)
REFUSED = Check(
    "refused", "share of observations refused since the last report", "1", "", 0.0, 0.99
)
PLANAR = Check(
    "planar",
    "share of observations in turns and across slopes since the last report",
    "1",
    "nothing is learnt there; if the rover does neither, correct roll, yaw rate, lateral velocity",
    0.0,
)
MODEL = Check(
    "model",
    "share of the last seconds of driving, at most 60, that the model left out; unknown before 10",
    "1",
    ADVICE,
    0.1,
    1.0 - LEAST_TAKEN,
)
FIT = Check(
    "fit",
    "root mean square by which the worst regression row missed the model in the last minute of"
    " driving, in predicted standard deviations; near 1 where the model is right",
    "1",
    "check the signals of that row first: velocity and slip, sinkage and mass, that axle's torque,"
    " the IMU, or the bogie's angle",
    2.0,
)
NUMERICS = Check(
    "numerics",
    "observations since the last report that failed numerically",
    "",
    "reset the estimator; report the recording",
    error=0.0,
)
FAILURES = Check(
    "callbacks",
    "callbacks that raised an exception since the last report",
    "",
    "read the log",
    error=0.0,
)
INNOVATION = Check(
    "innovation",
    "mean of the squared innovation over its predicted variance (NIS) since the last report, over"
    " at least five; near 1 when consistent",
    "1",
    "the measurements scatter more than their standard deviations, or the model belongs to"
    " another rover",
    3.0,
    10.0,
)
CONDITION = Check(
    "condition",
    "condition number of the scaled covariance",
    "1",
    "drive so that c and tan phi have different effects, for example on a slope",
    1e4,
    1e8,
)
LATENCY = Check(
    "latency",
    "longest time from a message's reception to the estimate that it completes, since the last"
    " report, including time in the queue",
    "s",
    "the machine is too busy: beyond 5 s messages are lost",
    0.2,
    1.0,
)
RUNTIME = Check(
    "runtime",
    "1 where TorchScript runs the model because there is no sound compiled core; the text says what"
    " runs it, and why not the core",
    "",
    "updates take several times as long: make the core, or set runtime to torchscript if that is"
    " meant",
    0.0,
)
SENSORS = Check(
    "sensors",
    "largest Cramer-Rao bound of tan phi over the model's soils, by the configured sensors in a"
    " reference drive; at most 0.8 is looked for, so smaller numbers are no measure of precision;"
    " unknown where the rover has no such drive",
    "prior deviations",
    "on soils with more the estimate stays near the prior: switch a sensor on, or state less noise",
    LARGEST_BOUND,
)
SAVING = Check(
    "saved state",
    "time for which a state has waited to be saved: writing fails or hangs",
    "s",
    "check the disk",
    1.0,
    10.0,
)
UNRECORDED = Check(
    "recording",
    "recorded topics without a publisher or with a type that is not installed",
    "",
    "start their publishers, source the workspace with the type, or leave the topics out",
    0.0,
)
DISK = Check(
    "disk",
    "delay of the last fsync of the recording: a power cut costs this much in addition to"
    " fsync_interval",
    "s",
    "use a faster disk",
    1.0,
    10.0,
)
CHECKS = (
    STATE,
    CLOCK,
    PUBLISHERS,
    REQUIRED,
    OPTIONAL,
    LOSSES,
    RATE,
    REFUSED,
    PLANAR,
    MODEL,
    FIT,
    NUMERICS,
    FAILURES,
    INNOVATION,
    CONDITION,
    LATENCY,
    RUNTIME,
    SENSORS,
    SAVING,
    UNRECORDED,
    DISK,
)
"""In the order of the page."""


def judge_runtime(runtime: str, why: str, configuration_sha256: str) -> CheckResult:
    """Tell what runs the model of a configuration.

    Args:
        runtime: of RUNTIMES, not ``auto``.
        why: the compiled core does not run although it was looked for; empty otherwise.
        configuration_sha256: which depends on the runtime, so that a reader can assign it.
    """
    reason = why or ("" if runtime == COMPILED else "the parameter runtime asks for it")
    text = f"the model runs by {runtime}" + (f": {reason}" if reason else "")
    details = (
        ("runtime", runtime),
        ("runtime_reason", reason),
        ("configuration_sha256", configuration_sha256),
    )
    return replace(RUNTIME.judge(1.0 if why else 0.0, text=text), details=details)


NOT_CHECKED = (
    "sensors not checked: the model has no reference drives: make it anew, or copy its .drive.npz"
)


def judge_information(largest: float, bounds: Mapping[str, float], doubt: str) -> CheckResult:
    """Tell what the configured sensors tell of tan phi.

    Args:
        largest: bound over the soils [prior deviations]; NaN where none was computed.
        bounds: the bound on each soil [prior deviations].
        doubt: what is too little, in words; empty where nothing is.
    """
    text = doubt or ("" if bounds else NOT_CHECKED)
    details = tuple((f"bound {soil}", f"{bound:.2g}") for soil, bound in bounds.items())
    return replace(SENSORS.judge(largest, text=text), details=details)


def worst(findings: Iterable[CheckResult]) -> tuple[Level, str]:
    """Return the highest level, and its results in words; empty where nothing is wrong."""
    every = list(findings)
    level = max((finding.level for finding in every), default=Level.OK)
    return level, (
        "; ".join(finding.message for finding in every if finding.level is level) if level else ""
    )


def table() -> str:
    """Return the checks as a Markdown table."""
    lines = [
        "| check | quantity | unit | WARN above | ERROR above | STALE above | what to do |",
        "|---|---|---|---|---|---|---|",
    ]
    for check in CHECKS:
        limits = " | ".join(
            "" if math.isinf(limit) else f"{limit:g}"
            for limit in (check.warn, check.error, check.stale)
        )
        lines.append(
            f"| {check.name} | {check.quantity} | {check.unit} | {limits} | {check.advice} |"
        )
    return "\n".join(lines)
