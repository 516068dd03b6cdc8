# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What is judged of a running node, and from which value on it is a warning or an error: the one table of thresholds.

A check takes a number and gives a finding; docs/diagnostics.md is written from the checks,
/diagnostics and estimator_health from the findings.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum


class Level(IntEnum):
    """Level of health; the values are those of msg_defs/EstimatorHealth and of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Check:
    """One quantity and its limits: a level holds where the quantity is above the level's limit; infinity where it never does."""

    name: str
    quantity: str
    unit: str
    advice: str
    warn: float = math.inf
    error: float = math.inf
    stale: float = math.inf

    def judge(self, value: float, subject: str = "", text: str = "") -> "CheckResult":
        """The finding for one value; NaN is a value that nothing is known of, and no fault.

        Args:
            value: in ``unit``.
            subject: what it is of, where there are several: a topic, for instance.
            text: it in words; by default the quantity and the value.
        """
        limits = ((Level.STALE, self.stale), (Level.ERROR, self.error), (Level.WARN, self.warn))
        level = next((level for level, limit in limits if value > limit), Level.OK)
        unit = "" if self.unit == "1" else f" {self.unit}"
        return CheckResult(
            self, subject, value, level, text or f"{self.quantity} is {value:.3g}{unit}".rstrip()
        )


@dataclass(frozen=True, slots=True)
class CheckResult:
    """One value, judged."""

    check: Check
    subject: str
    value: float
    level: Level
    text: str

    @property
    def name(self) -> str:
        """Of the check and what it is of."""
        return f"{self.check.name} {self.subject}".rstrip()

    @property
    def message(self) -> str:
        """In words, with advice where something is wrong."""
        return (
            f"{self.text} ({self.check.advice})" if self.level and self.check.advice else self.text
        )


STATE = Check(
    "lifecycle",
    "state of the node: 0 active, 1 not active, 2 its configuration failed",
    "",
    "activate it, or see its log",
    0.0,
    1.0,
)
CLOCK = Check(
    "clock",
    "time with use_sim_time in which /clock does not go on, looked at once a second",
    "s",
    "start the simulator or the player with a clock, or leave use_sim_time out; one that is paused"
    " stands still, too",
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
    "check its publisher and the topic's name",
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
    "messages lost, out of order or, on a required topic where an instant lacked one, without"
    " partner since the last report",
    "",
    "check stamps, load and network",
    0.0,
)
REFUSED = Check("refused", "share of the observations since the last report", "1", "", 0.0, 0.99)
NUMERICS = Check(
    "numerics",
    "observations since the last report that failed numerically",
    "",
    "reset the estimator, report the recording",
    error=0.0,
)
FAILURES = Check(
    "callbacks", "callbacks that raised since the last report", "", "see the log", error=0.0
)
INNOVATION = Check(
    "innovation",
    "mean squared innovation over its predicted variance (NIS) since the last report, over at least"
    " five: about 1 when honest",
    "1",
    "the measurements scatter more than their deviations say, or the model is another rover's",
    3.0,
    10.0,
)
CONDITION = Check(
    "condition",
    "condition number of the scaled covariance",
    "1",
    "drive so that c and tan phi act differently",
    1e4,
    1e8,
)
LATENCY = Check(
    "latency",
    "longest way from a message's reception to the estimate that it completes, since the last"
    " report; waiting in the queue counts",
    "s",
    "the machine is too busy: beyond 5 s messages are lost",
    0.2,
    1.0,
)
SAVING = Check(
    "saved state",
    "time for which the disk has owed a state: writing it fails, or does not end",
    "s",
    "see to the disk",
    1.0,
    10.0,
)
UNRECORDED = Check(
    "recording",
    "topics of the recorder that have no publisher now, or a type that is not installed",
    "",
    "start their publishers, source the workspace that has the type, or leave them out",
    0.0,
)
DISK = Check(
    "disk",
    "time by which the recording's last fsync is late: a power cut costs so much more than"
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
    REFUSED,
    NUMERICS,
    FAILURES,
    INNOVATION,
    CONDITION,
    LATENCY,
    SAVING,
    UNRECORDED,
    DISK,
)
"""In the order of the page."""


def worst(findings: Iterable[CheckResult]) -> tuple[Level, str]:
    """The highest level, and all findings of that level in words; empty where nothing is wrong."""
    every = list(findings)
    level = max((finding.level for finding in every), default=Level.OK)
    return level, (
        "; ".join(finding.message for finding in every if finding.level is level) if level else ""
    )


def table() -> str:
    """The checks as a table of Markdown."""
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
