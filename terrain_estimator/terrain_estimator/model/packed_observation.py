# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One observation as one flat vector, which the model takes.

With W wheels the layout is eight groups of W values, then the scalars (with the W wheel rates where
a model takes them, or the motion of a model by wheel), all SI and float64, NaN for "not measured".
One vector instead of sixteen keeps the call of the model cheap, and its layout is part of the model
file. One value stands for the wheels of an axle, so W is the number of axles; or that of wheels, in
a model by wheel. ``packing`` has the named view that the model uses.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from terrain_estimator.observation import Floats, Observation

PACKED_WHEEL_FIELDS = (
    "slip",
    "slip_sd",
    "sinkage",
    "sinkage_sd",
    "contact_angle",
    "contact_angle_sd",
    "torque",
    "torque_sd",
)
"""Groups of one value per wheel, front to rear; units as in Observation."""

PACKED_SCALAR_FIELDS = (
    "velocity",
    "velocity_sd",
    "pitch",
    "pitch_sd",
    "acceleration",
    "acceleration_sd",
    "bogie_angle",
    "step",
    "linked",
)
"""The scalars, of which two are about the time.

``step`` [s] is the time since the observation before; ``linked`` is 1 where that one was used and
the step is short.
"""

GROUPS = len(PACKED_WHEEL_FIELDS)
"""Number of values per wheel, without its rate."""
MEASURED = PACKED_SCALAR_FIELDS.index("step")
"""Number of measured scalars; behind them stand the wheel rates, where a model takes them."""
TIMING = len(PACKED_SCALAR_FIELDS) - MEASURED
"""Number of scalars about the time, which stand last."""
BLOCK = 10
"""Observations in a block: one second at 10 Hz."""


BY_WHEEL = (
    "lateral_velocity", "lateral_velocity_sd", "yaw_rate", "yaw_rate_sd", "roll", "roll_sd",
)  # fmt: skip
"""Scalars of a model by wheel, as in Observation; rims and steering come before them."""


def scalar_fields(wheels: int, *, rates: bool, by_wheel: bool = False) -> tuple[str, ...]:
    """Return the scalars of a model, whose last are ``step`` and ``linked``.

    ``rates`` puts the wheel rates [rad/s] before ``step``, ``by_wheel`` the speeds of the rims
    [m/s], the steering [rad] and the scalars BY_WHEEL.
    """
    turning = tuple(f"wheel_rate_{wheel}" for wheel in range(wheels)) if rates else ()
    if by_wheel:
        rims = [f"rim_{wheel}" for wheel in range(wheels)]
        turning = (*rims, *(f"steering_{wheel}" for wheel in range(wheels)), *BY_WHEEL)
    return (*PACKED_SCALAR_FIELDS[:MEASURED], *turning, *PACKED_SCALAR_FIELDS[MEASURED:])


def packed_size(wheels: int, *, rates: bool = False, by_wheel: bool = False) -> int:
    """Return the length P of a packed observation."""
    return GROUPS * wheels + len(scalar_fields(wheels, rates=rates, by_wheel=by_wheel))


LONGEST_GAP = 2.5
"""[steps] A longer time between two observations breaks the link between their velocities."""


def link(stamp_ns: int, last: Observation | None, step_s: float) -> tuple[float, bool]:
    """Return the time since the observation ``last``, and whether its velocity carries over.

    ``last`` is the last one that entered. The time is ``step_s`` where there is none.
    """
    if last is None:
        return step_s, False
    passed_s = (stamp_ns - last.stamp_ns) * 1e-9
    return passed_s, passed_s <= LONGEST_GAP * step_s


def ground_torque(
    observation: Observation, last: Observation | None, inertia: float, passed_s: float
) -> list[float]:
    """Return the torque on the ground [axles]: the motor's less I dw/dt (Banerjee et al. eq. 6).

    It is the motor's where ``last`` is None.
    """
    torques: list[float] = observation.torque.tolist()
    if last is None or inertia == 0.0:
        return torques
    # plain numbers: what an observation holds is too little for arrays
    spin = inertia / passed_s
    rates = zip(torques, observation.wheel_rate.tolist(), last.wheel_rate.tolist(), strict=True)
    return [torque - (rate - before) * spin for torque, rate, before in rates]


def pack(
    observation: Observation,
    torque: Sequence[float],
    step_s: float,
    *,
    linked: bool,
    rates: bool = False,
    body: "TurningBody | None" = None,
) -> Floats:
    """Return the observation as doubles [packed_size(axles, rates=rates)].

    ``torque`` [axles] is the observation's, [N m], less what turns the wheel's own inertia
    (docs/method.md, rows). A model that takes the wheel rates too cannot use a wheel whose rate is
    not known. ``body`` is given for a model by wheel.
    """
    slip, turning = observation.slip.tolist(), observation.wheel_rate.tolist() if rates else []
    if rates:
        both = zip(slip, turning, strict=True)
        slip = [each if math.isfinite(rate) else math.nan for each, rate in both]
    pitch = observation.pitch
    if body is not None:
        pitch, turning = body.pitch(observation), body.motion(observation)
    # in the order of PACKED_WHEEL_FIELDS and of the scalars
    return np.array(
        [
            *slip,
            *observation.slip_sd.tolist(),
            *observation.sinkage.tolist(),
            *observation.sinkage_sd.tolist(),
            *observation.contact_angle.tolist(),
            *observation.contact_angle_sd.tolist(),
            *torque,
            *observation.torque_sd.tolist(),
            observation.velocity,
            observation.velocity_sd,
            pitch,
            observation.pitch_sd,
            observation.acceleration,
            observation.acceleration_sd,
            observation.bogie_angle,
            *turning,
            step_s,
            1.0 if linked else 0.0,
        ]
    )


class TurningBody(NamedTuple):
    """What the packing of a rover that may turn needs of it."""

    radius: float  # [m] of the wheels
    gravity: float  # [m/s^2]
    centre_x: float  # [m] of the centre of mass

    def pitch(self, observation: Observation) -> float:
        """Return the pitch [rad] at which gravity pulls back as here, less the turn's part.

        A body that turns and moves aside accelerates ahead by dv_x/dt - omega v_y.
        """
        turn = observation.yaw_rate
        aside = observation.lateral_velocity + self.centre_x * turn
        sine = math.sin(observation.pitch) - turn * aside / self.gravity
        return math.asin(sine) if abs(sine) < 1.0 else math.nan

    def motion(self, observation: Observation) -> list[float]:
        """Return the rims' speeds, the steering and BY_WHEEL."""
        steering = observation.steering
        angles = [0.0] * len(observation.slip) if steering is None else steering.tolist()
        rims = [self.radius * rate for rate in observation.wheel_rate.tolist()]
        return [*rims, *angles, *(getattr(observation, name) for name in BY_WHEEL)]


def unpacked(packed: Floats, wheels: int) -> tuple[Observation, float, float]:
    """Return the observation without a stamp, step [s] and linked [1] of one vector [P].

    Its torques are those on the ground, its wheel rates NaN where the layout has none; those of a
    model by wheel are the rims' speeds, as of wheels of 1 m.
    """
    groups, rest = np.split(packed, [GROUPS * wheels])
    by_name: dict[str, Any] = dict(
        zip(PACKED_WHEEL_FIELDS, groups.reshape(GROUPS, wheels), strict=True)
    )
    scalars, rates, (step, linked) = np.split(rest, [MEASURED, len(rest) - TIMING])
    measured = dict(zip(PACKED_SCALAR_FIELDS[:MEASURED], scalars.tolist(), strict=True))
    if rates.size > wheels:
        rates, steering, motion = np.split(rates, [wheels, 2 * wheels])
        measured |= dict(zip(BY_WHEEL, motion.tolist(), strict=True))
        measured["steering"] = steering
    rates = rates if rates.size else np.full(wheels, np.nan)
    return Observation(stamp_ns=0, **by_name, wheel_rate=rates, **measured), step, linked
