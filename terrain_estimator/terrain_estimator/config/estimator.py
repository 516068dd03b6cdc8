# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the estimator: those that change estimates, and those of its node."""

import dataclasses
from dataclasses import dataclass, field

from rover_parameters.parameters import INLINE, effective, fingerprint
from rover_parameters.records import ConfigError, entry, number
from terrain_estimator.config.auto_start import AUTO_START
from terrain_estimator.topics import BODY_FRAME
from terramechanics.vehicle.wheel_places import WIDEST_SLIP

SLIPS = (-0.6, 0.95)
"""[1] Least and largest slip of a model by axle."""
SLIPS_BY_WHEEL = (-WIDEST_SLIP, WIDEST_SLIP)
"""[1] The same of a model by wheel."""
BESIDE_SDS = (0.005, 0.003)
"""[m/s], [rad/s] Supposed deviations of lateral velocity and yaw rate that refuse turns."""
TURN_LIMIT = 0.07
"""[1] Share of the rims' speed that an axle may move sideways, see docs/lateral.md."""


@dataclass(frozen=True, slots=True)
class CoreConfig:
    """Parameters of :class:`terrain_estimator.estimator.estimator.Estimator`."""

    use_torque: bool = entry("use the wheel torques of joint_states", default=True)
    use_imu: bool = entry(
        "use pitch and acceleration of imu; if false, the pitch of odom", default=True
    )
    use_moments: bool = entry(
        "use the moment balances of rover and bogie; needs the bogie's angle in joint_states",
        default=True,
    )
    use_sinkage: bool = entry(
        "use the sinkages of wheel_sinkage; if false, the balances of load and moments tell them,"
        " which needs use_torque and use_moments",
        default=True,
    )
    contact_angle_sd: float = number(
        "deviation of the ground below a wheel from the plane of its body or bogie, which is taken"
        " where a contact angle is missing; 0: such observations are refused",
        "rad",
        0.0,
        0.5,
        default=0.0,
    )
    prior_cohesion_mean_pa: float = number(
        "site knowledge: mean of the cohesion; needs prior.cohesion_sd",
        "Pa",
        0.0,
        1e6,
        default=0.0,
        key="prior.cohesion_mean",
    )
    prior_cohesion_sd_pa: float = number(
        "site knowledge: standard deviation of the cohesion; 0: the model's prior",
        "Pa",
        0.0,
        1e6,
        default=0.0,
        key="prior.cohesion_sd",
    )
    prior_tan_phi_mean: float = number(
        "site knowledge: mean of tan phi; needs prior.tan_phi_sd",
        "1",
        0.0,
        5.0,
        default=0.0,
        key="prior.tan_phi_mean",
    )
    prior_tan_phi_sd: float = number(
        "site knowledge: standard deviation of tan phi; 0: the model's prior",
        "1",
        0.0,
        5.0,
        default=0.0,
        key="prior.tan_phi_sd",
    )
    prior_soil: str = entry(
        "site knowledge: name of the soil; empty: all soils of the model are equally likely",
        "",
        key="prior.soil",
    )
    forgetting_time: float = number(
        "seconds of driving in which a random walk of c and tan phi reaches the prior's variance:"
        " forgets older data; at least 1; 0: the ground is constant between sharp changes",
        "s",
        0.0,
        1e6,
        default=0.0,
    )
    standstill_speed: float = number(
        "rim speed up to which all wheels count as standing (speed of the rover if no wheel rate is"
        " measured)",
        "m/s",
        0.0,
        1.0,
        default=0.01,
    )
    gate_probability: float = number(
        "share of good observations that the gates may refuse; 0: no gates",
        "1",
        0.0,
        0.1,
        default=1e-5,
    )
    slip_minimum: float = number(
        "wheels with less slip are left out; the model's range starts at -0.6, by wheel at -3",
        "1",
        SLIPS[0],
        0.0,
        default=SLIPS[0],
    )
    slip_maximum: float = number(
        "wheels with this slip or more are left out; the model's range ends at 0.95, by wheel at 3",
        "1",
        0.0,
        SLIPS[1],
        default=SLIPS[1],
    )

    roll_limit: float = number(
        "observations in which the rover leans further to a side are refused, since a model by axle"
        " does not; 0: no limit",
        "rad",
        0.0,
        1.6,
        default=0.06,
    )
    turn_limit: float = number(
        "observations in which an axle moves sideways by more than this share of the rims' speed"
        " and twice the noise are refused, since a model by axle drives straight; 0: no limit",
        "1",
        0.0,
        10.0,
        default=TURN_LIMIT,
    )

    def __post_init__(self) -> None:
        """Refuse half a prior, to forget within less than a second, and too few sensors.

        A mean without its deviation would do nothing, and a deviation alone would put the mean at
        0.
        """
        if not self.use_sinkage and not (self.use_torque and self.use_moments):
            raise ConfigError(
                "parameter use_sinkage: false needs use_torque and use_moments: without sinkages"
                " the balances tell these, and torques the ground"
            )
        if 0.0 < self.forgetting_time < 1.0:
            raise ConfigError(
                f"parameter forgetting_time: {self.forgetting_time:g} s is less than the second"
                " that the model takes at a time: give 0 for never, or at least 1"
            )
        for name, mean, sd in (
            ("cohesion", self.prior_cohesion_mean_pa, self.prior_cohesion_sd_pa),
            ("tan_phi", self.prior_tan_phi_mean, self.prior_tan_phi_sd),
        ):
            if mean > 0.0 and sd == 0.0:
                raise ConfigError(
                    f"parameter prior.{name}_mean: {mean:g} has no effect without prior.{name}_sd:"
                    " give both or none"
                )
            if sd > 0.0 and mean == 0.0:
                raise ConfigError(
                    f"parameter prior.{name}_sd: {sd:g} needs prior.{name}_mean above 0: give both"
                    " or none"
                )

    def of_velocity_alone(self) -> "CoreConfig":
        """Return the parameters for a model of the velocity row alone, without other sensors.

        The pitch is still that of the imu: it is read before.
        """
        return dataclasses.replace(self, use_torque=False, use_imu=False, use_moments=False)

    def of_model(self, *, by_wheel: bool) -> "CoreConfig":
        """Return the parameters for a model by axle or by wheel, whose range of slip is wider."""
        own = self.slip_minimum, self.slip_maximum
        if not by_wheel or own == SLIPS_BY_WHEEL:
            return self
        low, high = (
            wide if value == usual else value
            for value, usual, wide in zip(own, SLIPS, SLIPS_BY_WHEEL, strict=True)
        )
        return dataclasses.replace(self, slip_minimum=low, slip_maximum=high)

    @property
    def drift(self) -> float:
        """Random walk of c and tan phi [1/sqrt(s)], in prior deviations."""
        return self.forgetting_time**-0.5 if self.forgetting_time else 0.0


@dataclass(frozen=True, slots=True)
class ConversionConfig:
    """Parameters of the conversion of messages into an observation."""

    body_frame: str = entry("frame_id of the measurements; empty: any", BODY_FRAME, empty=True)
    torque_relative_sd: float = number(
        "standard deviation of a measured wheel torque, relative to the torque",
        "1",
        0.0,
        1.0,
        default=0.03,
        key="torque_noise.relative",
    )
    torque_absolute_sd: float = number(
        "constant standard deviation of a measured wheel torque, added in quadrature; 0: 1 % of 0.3"
        " r m g / (number of wheels)",
        "N m",
        0.0,
        1e6,
        default=0.0,
        key="torque_noise.absolute",
    )
    bogie_joint: str = entry(
        "name of the bogie's joint in joint_states; several names separated by commas", "bogie"
    )
    bogie_nose_down: bool = entry(
        "the angle of the bogie's joint is positive nose down (y axis as in REP 103); if false,"
        " nose up",
        default=False,
    )
    default_velocity_sd: float = number(
        "standard deviation for odom without a twist variance; 0: such an observation is refused",
        "m/s",
        0.0,
        10.0,
        default=0.0,
        key="default_sd.velocity",
    )
    default_pitch_sd: float = number(
        "standard deviation for a pitch without a variance; 0: such an observation is refused. A"
        " roll without one is known as well as the pitch",
        "rad",
        0.0,
        1.0,
        default=0.0,
        key="default_sd.pitch",
    )
    default_lateral_velocity_sd: float = number(
        "standard deviation of odom's lateral velocity without a variance; see turn_limit. A model"
        " by wheel, into whose estimate it enters, needs the variance, or another value here",
        "m/s",
        0.0,
        10.0,
        default=BESIDE_SDS[0],
        key="default_sd.lateral_velocity",
    )
    default_yaw_rate_sd: float = number(
        "standard deviation of a yaw rate without a variance; see turn_limit. A model by wheel,"
        " into whose estimate it enters, needs the variance, or another value here",
        "rad/s",
        0.0,
        10.0,
        default=BESIDE_SDS[1],
        key="default_sd.yaw_rate",
    )
    default_acceleration_sd: float = number(
        "standard deviation for imu without an acceleration variance; 0: the acceleration is"
        " left out",
        "m/s^2",
        0.0,
        10.0,
        default=0.0,
        key="default_sd.acceleration",
    )

    def of_model(self, *, by_wheel: bool) -> "ConversionConfig":
        """Return the parameters for a model by axle, or for one by wheel, which supposes nothing.

        An odometry that has no lateral velocity often publishes 0 with a variance of 0.
        """
        own = self.default_lateral_velocity_sd, self.default_yaw_rate_sd
        if not by_wheel:
            return self
        lateral, turn = (
            0.0 if value == usual else value for value, usual in zip(own, BESIDE_SDS, strict=True)
        )
        return dataclasses.replace(
            self, default_lateral_velocity_sd=lateral, default_yaw_rate_sd=turn
        )


@dataclass(frozen=True, slots=True)
class PairingConfig:
    """Parameters of the pairing of messages by stamp."""

    tolerance_s: float = number(
        "largest difference between the stamps of one observation; 0: equal stamps only",
        "s",
        0.0,
        1.0,
        default=0.0,
        key="pairing_tolerance",
    )
    timeout_s: float = number(
        "an observation waits for a missing message until the stamps of other topics are this much"
        " later",
        "s",
        0.0,
        60.0,
        default=0.5,
        key="pairing_timeout",
    )


AUTO, COMPILED, TORCHSCRIPT = "auto", "compiled", "torchscript"
RUNTIMES = (AUTO, COMPILED, TORCHSCRIPT)
"""What may run a model; ``auto``: the compiled core where there is one, else TorchScript."""


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """All parameters that change estimates: those of replay."""

    runtime: str = entry(
        "what runs the model: compiled, torchscript, or auto for the compiled core where there is"
        " one; replay takes the recorded one for auto",
        AUTO,
    )
    model: str = entry("name of an installed model, or path of a model file; empty: mars_rover", "")
    rover: str = entry("name or file of the rover; empty: the model's", "")
    core: CoreConfig = field(default_factory=CoreConfig, metadata=INLINE)
    conversion: ConversionConfig = field(default_factory=ConversionConfig, metadata=INLINE)
    pairing: PairingConfig = field(default_factory=PairingConfig, metadata=INLINE)

    def sha256(self, rover_sha256: str = "") -> str:
        """Return the fingerprint of everything that changes the output except the model file.

        The model file has a fingerprint of its own.

        Paths are left out: the same file in another folder gives the same estimates.
        ``rover_sha256`` stands for the contents of a rover file.
        """
        values = effective(self)
        del values["model"], values["rover"]
        if self.runtime != COMPILED:  # recordings are older than the other runtime
            del values["runtime"]
        return fingerprint(values | {"rover_sha256": rover_sha256})


@dataclass(frozen=True, slots=True)
class EstimatorNodeConfig:
    """All parameters of the estimator node.

    Those of ``estimator`` change estimates; the others concern the process alone.
    """

    estimator: EstimatorConfig = field(default_factory=EstimatorConfig, metadata=INLINE)
    auto_start: bool = entry(AUTO_START, default=True)
    state_file: str = entry(
        "file in which the state is saved, and from which the node continues when it is configured;"
        " empty: no file",
        "",
        key="state.file",
    )
    autosave_period_s: float = number(
        "time between two saves of the state, by the steady clock",
        "s",
        0.1,
        3600.0,
        default=10.0,
        key="state.autosave_period",
    )
