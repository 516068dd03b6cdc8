# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Build msg_defs/TractionAdvice, and read the planner's part of msg_defs/TerrainEstimate."""

import math
from collections.abc import Sequence

import numpy as np

from terrain_estimator.messaging.messages import Status
from terrain_estimator.planning.belief import Belief, widened
from terrain_estimator.planning.planner import Advice, Reason
from terrain_estimator.topics import ADVICE, Make, Message

_WORDS = {
    Reason.NONE: "go on",
    Reason.TRACTION: "stop: the ground may not hold the rover on this slope, or in this turn",
    Reason.FRONT: "stop: the ground under the front wheels may not hold the whole rover",
    Reason.SLIP: "stop: the wheels slip too much",
    Reason.SINKAGE: "stop: the wheels have sunk in too deep",
}
_UNKNOWN = {
    False: "c and tan phi are not identified",
    True: "the model of the estimate does not fit this rover or ground",
}
"""Why the margins are unknown, by whether the estimate disagrees."""
MOST_DEVIATIONS = 100.0
"""[1] Largest offset or spread of a row; a second counts for far less."""
_CREEP = "creep: no measurement while driving within the last seconds"


def belief_of_message(message: Message, soils: Sequence[str]) -> Belief:
    """Read the belief from a terrain_estimate over these ``soils``; ValueError if it is invalid."""
    if list(message.soil) != list(soils):
        raise ValueError(
            f"its soils are {', '.join(message.soil) or 'none'}, those of this planner's model are"
            f" {', '.join(soils)}"
        )
    probability = list(message.soil_probability)
    numbers = [
        message.cohesion,
        message.tan_phi,
        *message.covariance,
        *probability,
        message.change_probability,
        *message.fit_offset,
        *message.fit_spread,
    ]
    if not np.isfinite(numbers).all() or min(message.covariance[0], message.covariance[3]) < 0.0:
        raise ValueError("a number is not finite, or a variance is negative")
    if len(probability) != len(soils) or min(probability) < 0.0 or sum(probability) <= 0.0:
        raise ValueError(
            f"soil_probability is {probability}: it needs one number for each soil, none negative"
            " and not all zero"
        )
    if max(np.abs([*message.fit_offset, *message.fit_spread]), default=0.0) > MOST_DEVIATIONS:
        raise ValueError(f"a number of fit_offset or fit_spread is above {MOST_DEVIATIONS:g}")
    if len(message.fit_offset) != len(message.fit_spread):
        raise ValueError(
            f"fit_offset has {len(message.fit_offset)} numbers, fit_spread"
            f" {len(message.fit_spread)}: they need one for each row"
        )
    return Belief(
        mean=np.array([message.cohesion, message.tan_phi]),
        covariance=widened(
            np.asarray(message.covariance, dtype=np.float64).reshape(2, 2),
            zip(message.fit_offset, message.fit_spread, strict=True),
        ),
        soil_probability=tuple(probability),
        identified=bool(message.cohesion_identified and message.tan_phi_identified),
        change_probability=float(message.change_probability),
        disagrees=message.status == Status.DISAGREES,
    )


def advice_message(advice: Advice, make: Make, sequence: int, estimate: Message) -> Message:
    """Build msg_defs/TractionAdvice; ``estimate`` is the last terrain_estimate."""
    margins = advice.margins
    available, slip, sinkage = margins.available, margins.slip, margins.sinkage
    return make(
        ADVICE,
        header=estimate.header,
        sequence=sequence,
        estimate_sequence=estimate.sequence,
        known=advice.known,
        stop=advice.stop,
        stop_reason=int(advice.reason),
        status_text=_status_text(advice, estimate.effect),
        speed_limit=advice.speed_limit,
        commanded_speed=advice.rim_speed,
        slope=advice.slope,
        pull_available=available.median,
        pull_available_lower=available.lower,
        pull_available_upper=available.upper,
        pull_needed=margins.needed,
        traction_margin=available.median - margins.needed,
        traction_margin_lower=available.lower - margins.needed,
        stall_probability=margins.stall_probability,
        front_stall_probability=advice.front_stall_probability,
        slope_limit=margins.slope_limit.lower,
        slope_limit_median=margins.slope_limit.median,
        turn=advice.turn,
        turn_limit=advice.turn_limit.lower,
        turn_limit_median=advice.turn_limit.median,
        expected_slip=slip.median,
        expected_slip_lower=slip.lower,
        expected_slip_upper=slip.upper,
        expected_velocity=math.nan if advice.turning else advice.rim_speed * (1.0 - slip.median),
        expected_sinkage=sinkage.median,
        expected_sinkage_lower=sinkage.lower,
        expected_sinkage_upper=sinkage.upper,
        measured_slip=advice.slip,
        measured_sinkage=advice.sinkage,
    )


def _status_text(advice: Advice, effects: Sequence[str]) -> str:
    """Describe the advice, and what it leaves out; ``effects`` are those of the estimate."""
    parts = [] if advice.known else [f"margins unknown: {_UNKNOWN[advice.disagrees]}"]
    parts.append(_WORDS[advice.reason] if advice.stop or advice.moving else _CREEP)
    if advice.turning:
        parts.append("slip and front wheels not judged: the rover turns")
        if advice.known and math.isnan(advice.turn):
            parts.append("margins are for driving straight on")
    elif advice.moving and advice.front_lacks:
        parts.append(f"front wheels not judged: no {advice.front_lacks}")
    if advice.moving and math.isnan(advice.sinkage):
        parts.append("sinkage not judged: no measurement")
    if effects:
        parts.append(f"effects in the model are not taken into account: {', '.join(effects)}")
    return "; ".join(parts)
