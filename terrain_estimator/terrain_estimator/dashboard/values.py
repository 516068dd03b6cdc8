# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Messages as plain values of bounded length, with None for what is not finite."""

import math
from collections.abc import Callable, Iterable
from itertools import islice
from typing import Any

from terrain_estimator.intervals import OUTSIDE_68, credible_interval
from terrain_estimator.messaging.diagnostics import Level
from terrain_estimator.messaging.messages import Status
from terrain_estimator.outcome import Outcome
from terrain_estimator.pages.number_format import finite
from terrain_estimator.topics import ADVICE, ESTIMATE, HEALTH, INPUT_TYPES, TRUTH, Message

MOST = 16
"""Number of wheels, effects and topics that are shown; it bounds the cost of a message."""
_WORDS = 400  # characters of a text

Values = dict[str, Any]


def _all(values: Iterable[float]) -> list[float | None]:
    return [finite(value) for value in islice(values, MOST)]


def _names(values: Iterable[str]) -> list[str]:
    return [str(value)[:_WORDS] for value in islice(values, MOST)]


def _estimate(message: Message) -> Values:
    decision = message.decision
    parameters = {
        f"{name}{part}": finite(getattr(message, f"{name}{part}"))
        for name in ("cohesion", "tan_phi")
        for part in ("", "_stddev", "_lower_95", "_upper_95")
    }
    return {
        **parameters,
        **_bands_68(message),
        "cohesion_identified": bool(message.cohesion_identified),
        "tan_phi_identified": bool(message.tan_phi_identified),
        "change_probability": finite(message.change_probability),
        "soil": _names(message.soil),
        "soil_probability": _all(message.soil_probability),
        "effect": _names(message.effect),
        "effect_value": _all(message.effect_value),
        "effect_stddev": _all(message.effect_stddev),
        "effect_unit": _names(message.effect_unit),
        "status": Status(message.status).name,
        "status_text": message.status_text[:_WORDS],
        "outcome": Outcome(decision.outcome).name,
        "used": Outcome(decision.outcome).used,
        "advice": decision.advice[:_WORDS],
        "sequence": message.sequence,
        "observations_used": message.observations_used,
        "time_used": finite(message.time_used),
        "seconds_judged": message.seconds_judged,
        "seconds_taken": message.seconds_taken,
        "fit_row": _names(message.fit_row),
        "fit_offset": _all(message.fit_offset),
        "fit_spread": _all(message.fit_spread),
        "model": message.model_id[:_WORDS],
    }


def _bands_68(message: Message) -> Values:
    means, deviations = (
        (message.cohesion, message.tan_phi),
        (message.cohesion_stddev, message.tan_phi_stddev),
    )
    bounds: Values = {}
    for name, mean, sd in zip(("cohesion", "tan_phi"), means, deviations, strict=True):
        known = math.isfinite(mean) and math.isfinite(sd) and sd > 0.0
        lower, upper = credible_interval(mean, sd, OUTSIDE_68) if known else (math.nan, math.nan)
        bounds |= {
            f"{name}_lower_68": finite(float(lower)),
            f"{name}_upper_68": finite(float(upper)),
        }
    return bounds


def _slip(message: Message) -> Values:
    return {
        "wheel": _names(message.wheel),
        "slip": _all(message.slip),
        "slip_stddev": _all(message.slip_stddev),
    }


def _sinkage(message: Message) -> Values:
    return {
        "wheel": _names(message.wheel),
        "sinkage": _all(message.sinkage),
        "sinkage_stddev": _all(message.sinkage_stddev),
    }


def _odometry(message: Message) -> Values:
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    heading = math.atan2(
        2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2)
    )
    return {
        **{axis: finite(getattr(place, axis)) for axis in ("x", "y", "z")},
        "heading": finite(heading),
        "velocity": finite(message.twist.twist.linear.x),
        "frame": message.header.frame_id[:_WORDS],
    }


def _health(message: Message) -> Values:
    counts = dict(
        zip(_names(message.outcome), (int(count) for count in message.outcome_count), strict=False)
    )
    counters = ("received", "unpaired", "out_of_order", "lost")
    return {
        "level": Level(message.level).name,
        "summary": message.summary[:_WORDS],
        "accepted": message.accepted,
        "rejected": message.rejected,
        "seconds_taken": message.seconds_taken,
        "seconds_refused": message.seconds_refused,
        "outcomes": {name: count for name, count in counts.items() if count},
        "inputs": [
            {
                "topic": topic,
                **{name: int(getattr(message, f"input_{name}")[k]) for name in counters},
                "age": finite(message.input_age[k]),
            }
            for k, topic in enumerate(_names(message.input_topic))
        ],
        "normalized_innovation_squared": finite(message.normalized_innovation_squared),
        "update_latency_median": finite(message.update_latency_median),
        "update_latency_max": finite(message.update_latency_max),
        "resets": message.resets,
    }


def _advice(message: Message) -> Values:
    numbers = (
        "speed_limit",
        "slope_limit",
        "traction_margin",
        "traction_margin_lower",
        "stall_probability",
        "expected_slip",
    )
    return {
        "known": bool(message.known),
        "stop": bool(message.stop),
        "status_text": message.status_text[:_WORDS],
        **{name: finite(getattr(message, name)) for name in numbers},
    }


def _truth(message: Message) -> Values:
    return {
        "soil": message.soil[:_WORDS],
        "cohesion": finite(message.cohesion),
        "tan_phi": finite(message.tan_phi),
    }


TOPICS: dict[str, tuple[str, Callable[[Message], Values]]] = {
    "terrain_estimate": (ESTIMATE, _estimate),
    "wheel_slip": (INPUT_TYPES["wheel_slip"], _slip),
    "wheel_sinkage": (INPUT_TYPES["wheel_sinkage"], _sinkage),
    "odom": (INPUT_TYPES["odom"], _odometry),
    "estimator_health": (HEALTH, _health),
    "traction_advice": (ADVICE, _advice),
    "ground_truth/terrain": (TRUTH, _truth),
}
"""Type of every topic that is shown, and its reader."""
