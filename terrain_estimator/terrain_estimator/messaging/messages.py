# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Build the outgoing messages, for the live node and for replay alike.

The message classes come through a factory ``make(type_name, **fields)``. Arrays are passed to it
as sequences or NumPy arrays; it converts them to what its classes need.
"""

import math
from dataclasses import dataclass
from enum import IntEnum

from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.messaging.health import Health
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import DECISION, ESTIMATE, HEALTH, PREDICTION, Make, Message
from terrain_estimator.update import Decision, Update

_MASS_WORTH_REPORTING = 0.025  # from here on zero cuts the 95 % interval


class Status(IntEnum):
    """Status of an estimate; the values are those of msg_defs/TerrainEstimate."""

    PRIOR_ONLY = 0
    CONVERGING = 1
    IDENTIFIED = 2
    STANDING_STILL = 3
    DEGRADED = 4
    DISAGREES = 5


@dataclass(frozen=True, slots=True)
class Meta:
    """Fields that all messages of a run share."""

    model_id: str
    model_sha256: str
    configuration_sha256: str
    rows: tuple[str, ...]  # all regression rows that the model can use
    body_frame: str


def status_of(update: Update, rows: tuple[str, ...]) -> Status:
    """Return the status after one observation; ``rows`` are all that the model can use."""
    decision, estimate = update.decision, update.estimate
    if update.disagreements:
        return Status.DISAGREES
    if decision.outcome is Outcome.STANDSTILL:
        return Status.STANDING_STILL
    if not decision.outcome.used or _missing(rows, decision):
        return Status.DEGRADED
    if estimate.observations_used == 0:
        return Status.PRIOR_ONLY
    return Status.IDENTIFIED if all(estimate.identified) else Status.CONVERGING


def status_text(
    update: Update, status: Status, rows: tuple[str, ...], notes: tuple[str, ...]
) -> str:
    """Describe the status: what is not identified, what is missing, and why."""
    decision, estimate = update.decision, update.estimate
    parts = [status.name.lower().replace("_", " ")]
    if update.disagreements:
        parts += [f"{each.finding}; {each.advice}" for each in update.disagreements]
        parts.append("c and tan phi are the prior's")
    elif update.unconfirmed:
        parts.append(f"not identified yet: the model is not confirmed: {update.unconfirmed}")
    elif not all(estimate.identified):
        open_names = [
            name
            for name, known in zip(("cohesion", "tan phi"), estimate.identified, strict=True)
            if not known
        ]
        parts.append(f"not identified yet: {', '.join(open_names)}")
    missing = _missing(rows, decision)
    if missing and decision.outcome.used:
        parts.append(f"rows missing: {', '.join(missing)}")
    if estimate.mass_below_zero > _MASS_WORTH_REPORTING:
        parts.append(
            f"{estimate.mass_below_zero:.0%} of the posterior is below zero, the interval stops"
            " there"
        )
    if decision.detail:
        parts.append(f"{decision.outcome.name}: {decision.detail}")
    return "; ".join([*parts, *notes, *update.warnings])


def _missing(rows: tuple[str, ...], decision: Decision) -> list[str]:
    """Return the rows that the decision lacks."""
    used = decision.rows_used
    return [] if used == rows else [row for row in rows if row not in used]


def update_header(update: Update, make: Make, meta: Meta) -> Message:
    """Return the header of all messages of one observation: its stamp, and the body's frame."""
    sec, nanosec = divmod(update.stamp_ns, 1_000_000_000)
    return make(
        "std_msgs/msg/Header",
        stamp=make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec),
        frame_id=meta.body_frame,
    )


def estimate_message(
    update: Update, make: Make, meta: Meta, header: Message, notes: tuple[str, ...] = ()
) -> Message:
    """Build msg_defs/TerrainEstimate from one update.

    ``notes`` name the wheels and sensors that the conversion left out.
    """
    estimate = update.estimate
    status = status_of(update, meta.rows)
    (cohesion, tan_phi), covariance = estimate.mean.tolist(), estimate.covariance.ravel().tolist()
    lower, upper = estimate.lower_95.tolist(), estimate.upper_95.tolist()
    return make(
        ESTIMATE,
        header=header,
        sequence=update.sequence,
        model_id=meta.model_id,
        model_sha256=meta.model_sha256,
        configuration_sha256=meta.configuration_sha256,
        cohesion=cohesion,
        cohesion_stddev=math.sqrt(covariance[0]),
        cohesion_lower_95=lower[0],
        cohesion_upper_95=upper[0],
        tan_phi=tan_phi,
        tan_phi_stddev=math.sqrt(covariance[3]),
        tan_phi_lower_95=lower[1],
        tan_phi_upper_95=upper[1],
        covariance=covariance,
        cohesion_identified=bool(estimate.identified[0]),
        tan_phi_identified=bool(estimate.identified[1]),
        mass_below_zero=estimate.mass_below_zero,
        change_probability=estimate.change_probability,
        soil=estimate.soils,
        soil_probability=estimate.soil_probability,
        effect=[effect.name for effect in estimate.effects],
        effect_value=[effect.mean for effect in estimate.effects],
        effect_stddev=[effect.sd for effect in estimate.effects],
        effect_unit=[effect.unit for effect in estimate.effects],
        status=int(status),
        status_text=status_text(update, status, meta.rows, notes),
        rows=update.decision.rows_used,
        observations_used=estimate.observations_used,
        observations_waiting=estimate.observations_waiting,
        time_used=estimate.time_used_s,
        seconds_judged=estimate.seconds.judged,
        seconds_taken=estimate.seconds.taken,
        fit_row=[fit.row for fit in estimate.fit],
        fit_offset=[fit.offset for fit in estimate.fit],
        fit_spread=[fit.spread for fit in estimate.fit],
        decision=_decision_message(update.decision, make),
    )


def prediction_message(update: Update, make: Make, meta: Meta, header: Message) -> Message:
    """Build msg_defs/MotionPrediction from one update, with NaN where it is not valid."""
    prediction = update.prediction
    valid = bool(prediction.valid)
    velocity, variance = (
        (prediction.velocity, prediction.variance) if valid else (math.nan, math.nan)
    )
    half_width = HALF_WIDTH_95 * math.sqrt(variance) if valid else math.nan
    return make(
        PREDICTION,
        header=header,
        sequence=update.sequence,
        child_frame_id=meta.body_frame,
        valid=valid,
        horizon=prediction.horizon_s,
        velocity=velocity,
        velocity_variance=variance,
        velocity_lower_95=velocity - half_width,
        velocity_upper_95=velocity + half_width,
        measured_velocity=prediction.measured,
        innovation=prediction.innovation,
        innovation_variance=prediction.innovation_variance,
    )


def health_message(health: Health, make: Make, meta: Meta, header: Message) -> Message:
    """Build msg_defs/EstimatorHealth; ``header`` carries the node's clock."""
    inputs = health.inputs
    return make(
        HEALTH,
        header=header,
        sequence=health.sequence,
        level=int(health.level),
        summary=health.summary,
        model_id=meta.model_id,
        model_sha256=meta.model_sha256,
        configuration_sha256=meta.configuration_sha256,
        accepted=health.accepted,
        rejected=health.rejected,
        seconds_taken=health.seconds_taken,
        seconds_refused=health.seconds_refused,
        outcome=[outcome.name for outcome in Outcome],
        outcome_count=[health.outcomes.get(outcome, 0) for outcome in Outcome],
        input_topic=[entry.topic for entry in inputs],
        input_received=[entry.received for entry in inputs],
        input_unpaired=[entry.unpaired for entry in inputs],
        input_out_of_order=[entry.out_of_order for entry in inputs],
        input_lost=[entry.lost for entry in inputs],
        input_age=[entry.age_s for entry in inputs],
        normalized_innovation_squared=health.normalized_innovation_squared,
        condition_number=health.condition_number,
        update_latency_median=health.latency_median_s,
        update_latency_max=health.latency_max_s,
        resets=health.resets,
    )


def _decision_message(decision: Decision, make: Make) -> Message:
    return make(
        DECISION,
        outcome=int(decision.outcome),
        outcome_name=decision.outcome.name,
        advice=decision.outcome.advice,
        settled=decision.settled,
        rows_used=decision.rows_used,
        mahalanobis_squared=decision.mahalanobis_squared,
        threshold=decision.threshold,
        degrees_of_freedom=decision.degrees_of_freedom,
    )
