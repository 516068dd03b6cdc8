# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the planner and its node."""

from dataclasses import dataclass, field

from rover_parameters.parameters import INLINE
from rover_parameters.records import entry, number
from terrain_estimator.config.estimator import PairingConfig


def pull_deviation_entry() -> float:
    """Return the entry for the doubt of a forecast pull, which planner and map have."""
    return number(
        "standard deviation of the pull in addition to that from c and tan phi, for unknown soil"
        " constants and effects",
        "weights",
        0.0,
        1.0,
        default=0.015,
    )


@dataclass(frozen=True, slots=True)
class AdviceConfig:
    """Parameters of :class:`terrain_estimator.planning.planner.Planner`."""

    slip_limit: float = number(
        "slip up to which pull counts as available, and above which the rover should stop",
        "1",
        0.1,
        0.9,
        default=0.6,
    )
    sinkage_limit: float = number(
        "mean sinkage above which the rover should stop", "wheel radii", 0.01, 0.95, default=0.5
    )
    stop_probability: float = number(
        "probability of being stuck above which the rover should stop",
        "1",
        0.001,
        0.999,
        default=0.5,
    )
    pull_deviation: float = pull_deviation_entry()
    window_s: float = number(
        "time over which measurements are averaged; outliers are left out",
        "s",
        0.1,
        60.0,
        default=2.0,
        key="window",
    )
    reaction_s: float = number(
        "time from new ground under the front wheels to braking",
        "s",
        0.0,
        60.0,
        default=2.5,
        key="reaction_time",
    )
    deceleration: float = number(
        "deceleration with which the rover stops", "m/s^2", 0.001, 10.0, default=0.2
    )
    standstill_speed: float = number(
        "rim speed up to which all wheels count as standing; the rover creeps at twice this speed"
        " or faster",
        "m/s",
        0.0,
        1.0,
        default=0.01,
    )


@dataclass(frozen=True, slots=True)
class PlannerConfig:
    """All parameters of the planner node."""

    model: str = entry(
        "name of an installed model, or path of a model file, as for the estimator; empty:"
        " mars_rover",
        "",
    )
    rover: str = entry("name or file of the rover; empty: the model's", "")
    use_torque: bool = entry(
        "judge the ground under the front wheels by the wheel torques of joint_states", default=True
    )
    use_sinkage: bool = entry(
        "judge sinkages; without them the front wheels' ground is not judged either", default=True
    )
    use_imu: bool = entry("use the pitch of imu; if false, that of odom", default=True)
    period_s: float = number(
        "time between two pieces of advice, by their stamps",
        "s",
        0.1,
        60.0,
        default=0.5,
        key="period",
    )
    advice: AdviceConfig = field(default_factory=AdviceConfig, metadata=INLINE)
    pairing: PairingConfig = field(default_factory=PairingConfig, metadata=INLINE)
