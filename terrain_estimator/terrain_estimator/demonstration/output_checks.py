# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the outputs of a simulated drive, one verdict each."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from terrain_estimator.topics import INPUT_TYPES, Message

OUTPUTS = (
    *INPUT_TYPES,
    "ground_truth/terrain",
    "terrain_estimate",
    "motion_prediction",
    "estimator_health",
    "traction_advice",
    "terrain_map",
)
"""All outputs that are checked."""
FAR = 4.0
"""[standard deviations] Distance of a wrong estimate; chance reaches it once in 16000 drives."""
CONSISTENT = (0.3, 3.0)
"""[1] Range of the mean squared normalised innovation of consistent velocity predictions."""


@dataclass(frozen=True, slots=True)
class OutputVerdict:
    """Verdict on one output."""

    output: str
    fault: str  # empty: passed


def verdicts(messages: Mapping[str, Sequence[Message]], steps: int) -> list[OutputVerdict]:
    """Return one verdict for each of OUTPUTS.

    ``messages`` are by topic, from a drive of ``steps`` samples.
    """
    checks: dict[str, Callable[[], str]] = {
        "ground_truth/terrain": lambda: "",
        "terrain_estimate": lambda: (
            _missing(messages, "terrain_estimate", steps) or _wrong_estimate(messages)
        ),
        "motion_prediction": lambda: (
            _missing(messages, "motion_prediction", steps)
            or _wrong_prediction(messages["motion_prediction"])
        ),
        "estimator_health": lambda: _unhealthy(messages["estimator_health"][-1]),
        "traction_advice": lambda: _wrong_advice(messages["traction_advice"][-1]),
        "terrain_map": lambda: (
            "" if messages["terrain_map"][-1].width > 0 else "the last cloud has no point"
        ),
    }
    found = []
    for output in OUTPUTS:
        fault = "no message arrived" if not messages.get(output) else ""
        found.append(
            OutputVerdict(
                output,
                fault
                or (checks[output]() if output in checks else _missing(messages, output, steps)),
            )
        )
    return found


def _missing(messages: Mapping[str, Sequence[Message]], topic: str, steps: int) -> str:
    count = len(messages[topic])
    return "" if count == steps else f"{count} messages arrived, {steps} were expected"


def _wrong_estimate(messages: Mapping[str, Sequence[Message]]) -> str:
    last, truth = (
        messages["terrain_estimate"][-1],
        (messages.get("ground_truth/terrain") or [None])[-1],
    )
    if truth is None:
        return "there is no ground truth to compare with"
    for name in ("cohesion", "tan_phi"):
        mean, sd, true = getattr(last, name), getattr(last, f"{name}_stddev"), getattr(truth, name)
        if not abs(mean - true) < FAR * sd:
            return (
                f"{name} {mean:.4g} with standard deviation {sd:.3g} is far from the truth"
                f" {true:.4g}"
            )
    return ""


def _wrong_prediction(predictions: Sequence[Message]) -> str:
    squares = [
        each.innovation**2 / each.innovation_variance
        for each in predictions
        if math.isfinite(each.innovation)
    ]
    if len(squares) < len(predictions) / 2:
        return (
            f"{len(squares)} of {len(predictions)} predictions could be compared with a measurement"
        )
    mean = sum(squares) / len(squares)
    return (
        ""
        if CONSISTENT[0] < mean < CONSISTENT[1]
        else f"the mean squared normalised innovation is {mean:.2f}, not near 1"
    )


def _unhealthy(health: Message) -> str:
    return (
        f"{health.rejected} observations were rejected: {health.summary}"
        if health.rejected or not health.accepted
        else ""
    )


def _wrong_advice(advice: Message) -> str:
    if advice.stop:
        return f"it advises {advice.status_text!r} on ground that holds the rover"
    numbers = (
        advice.speed_limit,
        advice.measured_slip,
        advice.measured_sinkage,
        advice.front_stall_probability,
    )
    return (
        ""
        if all(math.isfinite(number) for number in numbers)
        else f"{advice.status_text}, and a number is missing"
    )
