# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""States that a message reports and that the journal follows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from terrain_estimator.dashboard.values import Values
from terrain_estimator.messaging.messages import Status
from terrain_estimator.outcome import Outcome

LIKELY = 0.5
"""[1] Probability from which a change of the ground is an event."""
_LEVELS = {"OK": "ok", "WARN": "warn"}
_STATUS_LEVELS = {Status.DEGRADED.name: "warn", Status.DISAGREES.name: "error"}


@dataclass(frozen=True, slots=True)
class LaneState:
    """State of one lane of the journal, with the event that its beginning is."""

    lane: str
    state: str  # empty: the ordinary one
    level: str  # ok, warn, error
    text: str


def reported_states(topic: str, values: Values) -> Iterator[LaneState]:
    """Yield the states that a message of a topic reports."""
    if topic in _STATES:
        yield from _STATES[topic](values)


def _of_estimate(values: Values) -> Iterator[LaneState]:
    refused = not values["used"] and values["outcome"] != Outcome.STANDSTILL.name
    if refused:
        text = f"{values['outcome']}: {values['advice']}"
        yield LaneState("outcome", values["outcome"], "warn", text)
    else:
        yield LaneState("outcome", "", "ok", "observations are accepted again")
    disagrees = values["status"] == Status.DISAGREES.name
    if disagrees or not refused:  # a single refusal is no status of the estimate
        level = _STATUS_LEVELS.get(values["status"], "ok")
        yield LaneState("status", values["status"], level, values["status_text"])
    probability = values["change_probability"] or 0.0
    if probability > LIKELY:
        text = f"the ground changed (probability {probability:.0%})"
        yield LaneState("ground", "changed", "warn", text)
    else:
        yield LaneState("ground", "", "ok", "the ground has settled")


def _of_health(values: Values) -> Iterator[LaneState]:
    level = _LEVELS.get(values["level"], "error")
    yield LaneState("health", values["level"], level, f"health: {values['summary']}")
    resets = values["resets"]
    text = (
        f"the posterior was reset ({resets} times since the start)"
        if resets
        else "the estimator restarted"
    )
    yield LaneState("resets", str(resets or ""), "warn", text)


def _of_advice(values: Values) -> Iterator[LaneState]:
    if values["stop"]:
        yield LaneState("stop", "stop", "error", f"planner: {values['status_text']}")
    else:
        yield LaneState("stop", "", "ok", "planner: the stop recommendation is withdrawn")


_STATES: dict[str, Callable[[Values], Iterator[LaneState]]] = {
    "terrain_estimate": _of_estimate,
    "estimator_health": _of_health,
    "traction_advice": _of_advice,
}
