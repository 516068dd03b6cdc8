# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a drive as estimator, planner and simulator publish them, with distinct numbers."""

import math
from collections.abc import Iterator
from typing import Any

from terrain_estimator.topics import ADVICE, ESTIMATE, HEALTH, INPUT_TYPES, TRUTH, Make

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
START_S = 1_700_000_000


def header(make: Make, step: int, frame: str = "base_link") -> Any:
    seconds, tenths = divmod(step, 10)
    stamp = make("builtin_interfaces/msg/Time", sec=START_S + seconds, nanosec=100_000_000 * tenths)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def estimate(make: Make, step: int, **fields: Any) -> Any:
    decision = make(
        "msg_defs/msg/MeasurementDecision",
        outcome=0,
        outcome_name="ACCEPTED",
        advice="",
        rows_used=[],
        mahalanobis_squared=1.0,
        threshold=9.0,
        degrees_of_freedom=3,
    )
    values: dict[str, Any] = {
        "header": header(make, step),
        "sequence": step,
        "model_id": "mars_rover-7",
        "model_sha256": "",
        "configuration_sha256": "",
        "cohesion": 1500.0 + step,
        "cohesion_stddev": 100.25,
        "cohesion_lower_95": 1303.5 + step,
        "cohesion_upper_95": 1696.5 + step,
        "tan_phi": 0.6 + 1e-4 * step,
        "tan_phi_stddev": 0.0123,
        "tan_phi_lower_95": 0.5759,
        "tan_phi_upper_95": 0.6241,
        "covariance": [1e4, 0.0, 0.0, 1e-4],
        "cohesion_identified": True,
        "tan_phi_identified": True,
        "mass_below_zero": 0.0,
        "change_probability": 0.0125,
        "soil": ["loose_sand"],
        "soil_probability": [1.0],
        "effect": ["drive_drag", "slope_bias"],
        "effect_value": [0.2005, -0.01],
        "effect_stddev": [0.0031, 0.02],
        "effect_unit": ["N m s/rad", "rad"],
        "status": 2,
        "status_text": "identified",
        "rows": [],
        "observations_used": step,
        "time_used": 0.1 * step,
        "seconds_judged": min(step // 10, 60),
        "seconds_taken": min(step // 10, 60),
        "fit_row": ["velocity", "torque_1"],
        "fit_offset": [0.0412, -1.2345],
        "fit_spread": [1.0123, 1.4988],
        "decision": decision,
    }
    return make(ESTIMATE, **values | fields)


def refused(make: Make, step: int) -> Any:
    message = estimate(make, step, status=4, status_text="degraded; GATED: too far")
    message.decision.outcome, message.decision.outcome_name, message.decision.advice = (
        10,
        "GATED",
        "the ground changed, or a sensor failed",
    )
    return message


def health(make: Make, step: int, level: int = 0, summary: str = "estimating") -> Any:
    return make(
        HEALTH,
        header=header(make, step),
        sequence=step,
        level=level,
        summary=summary,
        model_id="",
        model_sha256="",
        configuration_sha256="",
        accepted=step,
        rejected=7,
        seconds_taken=step // 10,
        seconds_refused=0,
        outcome=["ACCEPTED", "GATED", "DUPLICATE"],
        outcome_count=[step, 7, 0],
        input_topic=["wheel_slip"],
        input_received=[step],
        input_unpaired=[2],
        input_out_of_order=[0],
        input_lost=[1],
        input_age=[0.05],
        normalized_innovation_squared=1.07,
        condition_number=12.0,
        update_latency_median=0.00125,
        update_latency_max=0.004,
        resets=0,
    )


def advice(make: Make, step: int, *, stop: bool) -> Any:
    message = make(
        ADVICE,
        header=header(make, step),
        sequence=step,
        known=True,
        stop=stop,
        status_text="the wheels slip",
        **ADVICE_NUMBERS,
    )
    if stop:
        message.speed_limit = 0.0
    return message


ADVICE_NUMBERS: dict[str, Any] = {
    "estimate_sequence": 0,
    "stop_reason": 0,
    "speed_limit": 0.0815,
} | dict.fromkeys(
    (
        "commanded_speed",
        "slope",
        "pull_available",
        "pull_available_lower",
        "pull_available_upper",
        "pull_needed",
        "traction_margin",
        "traction_margin_lower",
        "stall_probability",
        "front_stall_probability",
        "slope_limit",
        "slope_limit_median",
        "expected_slip",
        "expected_slip_lower",
        "expected_slip_upper",
        "expected_velocity",
        "expected_sinkage",
        "expected_sinkage_lower",
        "expected_sinkage_upper",
        "measured_slip",
        "measured_sinkage",
    ),
    math.nan,
)


def truth(make: Make) -> Any:
    numbers = (
        "position",
        "friction_angle",
        "sinkage_exponent",
        "cohesive_modulus",
        "frictional_modulus",
        "shear_modulus",
        "stress_angle_offset",
        "stress_angle_slope",
    )
    given = {
        "header": header(make, 0),
        "sequence": 0,
        "soil": "loose_sand",
        "cohesion": 1480.0,
        "tan_phi": 0.61,
    }
    return make(
        TRUTH, **given, **dict.fromkeys(numbers, 0.0), effect=[], effect_value=[], effect_unit=[]
    )


def measured(make: Make, step: int) -> Iterator[tuple[str, Any]]:
    """Yield slip, sinkage and odometry of one instant."""
    count = len(WHEELS)
    common = {"header": header(make, step), "sequence": step}
    slip = {
        "wheel": list(WHEELS),
        "slip": [0.1 + 0.01 * k + 1e-4 * step for k in range(count)],
        "slip_stddev": [0.01] * count,
    }
    depths = [0.015 + 0.001 * k + 1e-5 * step for k in reversed(range(count))]
    sinkage = {
        "wheel": list(reversed(WHEELS)),
        "sinkage": depths,
        "sinkage_stddev": [0.001] * count,
    }  # in an order of its own
    angles = {"contact_angle": [0.0] * count, "contact_angle_stddev": [0.01] * count}
    yield "wheel_slip", make(INPUT_TYPES["wheel_slip"], **common, **slip)
    yield "wheel_sinkage", make(INPUT_TYPES["wheel_sinkage"], **common, **sinkage, **angles)
    yield "odom", odometry(make, step)


def odometry(make: Make, step: int) -> Any:
    place = make("geometry_msgs/msg/Point", x=0.01 * step, y=2.0 + 0.002 * step, z=0.3)
    turn = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(0.25), w=math.cos(0.25))
    zero = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    twist = make(
        "geometry_msgs/msg/Twist",
        linear=make("geometry_msgs/msg/Vector3", x=0.0912, y=0.0, z=0.0),
        angular=zero,
    )
    pose = make("geometry_msgs/msg/Pose", position=place, orientation=turn)
    return make(
        INPUT_TYPES["odom"],
        header=header(make, step, "odom"),
        child_frame_id="base_link",
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=[0.0] * 36),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=[0.0] * 36),
    )


def instant(make: Make, step: int) -> Iterator[tuple[str, Any]]:
    """Yield all messages of one instant at 10 Hz."""
    yield from measured(make, step)
    yield "terrain_estimate", estimate(make, step)
