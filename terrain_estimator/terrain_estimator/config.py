# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the estimator, defined once: the node declares them, ``replay --params-file`` reads them."""

from dataclasses import dataclass, field

from terrain_estimator.parameters import ParameterError, effective, fingerprint, parameter


@dataclass(frozen=True, slots=True)
class CoreConfig:
    """What :class:`terrain_estimator.estimator.Estimator` takes: nothing of topics, stamps or frames."""

    use_torque: bool = parameter("use_torque", default=True, description="use the wheel torques of joint_states")
    use_imu: bool = parameter("use_imu", default=True, description="use pitch and acceleration of imu; else pitch of odom")
    use_moments: bool = parameter(
        "use_moments", default=True, description="use the moment balances of rover and bogie; they need the bogie's angle in joint_states"
    )
    prior_cohesion_mean_pa: float = parameter(
        "prior.cohesion_mean", 0.0, "site knowledge: mean of the cohesion (with prior.cohesion_sd)", unit="Pa", minimum=0.0, maximum=1e6
    )
    prior_cohesion_sd_pa: float = parameter(
        "prior.cohesion_sd", 0.0, "site knowledge: its standard deviation; 0 takes the model's prior", unit="Pa", minimum=0.0, maximum=1e6
    )
    prior_tan_phi_mean: float = parameter(
        "prior.tan_phi_mean", 0.0, "site knowledge: mean of tan phi (with prior.tan_phi_sd)", minimum=0.0, maximum=5.0
    )
    prior_tan_phi_sd: float = parameter(
        "prior.tan_phi_sd", 0.0, "site knowledge: its standard deviation; 0 takes the model's prior", minimum=0.0, maximum=5.0
    )
    prior_soil: str = parameter(
        "prior.soil", default="", description="site knowledge: name of the soil; empty takes all that the model knows for equally likely"
    )
    drift: float = parameter(
        "drift",
        0.0,
        "random walk of c and tan phi, in prior deviations per square root of a second of driving: forgets what is older; "
        "0 takes the ground for constant between sharp changes",
        unit="1/sqrt(s)",
        minimum=0.0,
        maximum=1.0,
    )
    standstill_speed: float = parameter(
        "standstill_speed",
        0.01,
        "the rover stands where no wheel's rim is faster (the rover itself, where no wheel rate is measured)",
        unit="m/s",
        minimum=0.0,
        maximum=1.0,
    )
    gate_probability: float = parameter(
        "gate_probability",
        1e-5,
        "share of good observations that the gates may reject; 0 switches them off",
        minimum=0.0,
        maximum=0.1,
    )
    slip_minimum: float = parameter("slip_minimum", -1.0, "a wheel with less slip is left out", minimum=-10.0, maximum=0.0)
    slip_maximum: float = parameter("slip_maximum", 1.0, "a wheel with this slip or more is left out", minimum=0.0, maximum=1.0)

    def __post_init__(self) -> None:
        """Refuse half a prior: a mean without its deviation would silently do nothing."""
        for name, mean, sd in (
            ("cohesion", self.prior_cohesion_mean_pa, self.prior_cohesion_sd_pa),
            ("tan_phi", self.prior_tan_phi_mean, self.prior_tan_phi_sd),
        ):
            if mean > 0.0 and sd == 0.0:
                raise ParameterError(f"parameter prior.{name}_mean: {mean:g} has no effect without prior.{name}_sd: give both or none")


@dataclass(frozen=True, slots=True)
class ConversionConfig:
    """How messages become an observation."""

    body_frame: str = parameter("body_frame", default="base_link", description="frame_id of the measurements; empty accepts any")
    torque_relative_sd: float = parameter(
        "torque_noise.relative", 0.03, "standard deviation of a measured wheel torque, as a fraction of it", minimum=0.0, maximum=1.0
    )
    torque_absolute_sd: float = parameter(
        "torque_noise.absolute",
        0.0,
        "standard deviation of a measured wheel torque, added in quadrature; 0 takes 1 % of 0.3 r m g / (number of wheels)",
        unit="N m",
        minimum=0.0,
        maximum=1e6,
    )
    bogie_joint: str = parameter(
        "bogie_joint", default="bogie", description="name of the bogie's joint, or of several by commas, in joint_states"
    )
    bogie_nose_down: bool = parameter(
        "bogie_nose_down",
        default=False,
        description="the bogie's joint counts nose down as positive (a y axis as in REP-103); else nose up",
    )
    default_velocity_sd: float = parameter(
        "default_sd.velocity",
        0.0,
        "for odom without a twist variance; 0 refuses such an observation",
        unit="m/s",
        minimum=0.0,
        maximum=10.0,
    )
    default_pitch_sd: float = parameter(
        "default_sd.pitch", 0.0, "for a pitch without a variance; 0 refuses such an observation", unit="rad", minimum=0.0, maximum=1.0
    )
    default_acceleration_sd: float = parameter(
        "default_sd.acceleration", 0.0, "for imu without an acceleration variance; 0 leaves it out", unit="m/s^2", minimum=0.0, maximum=10.0
    )


@dataclass(frozen=True, slots=True)
class PairingConfig:
    """How messages of several topics are paired by stamp."""

    tolerance_s: float = parameter(
        "pairing_tolerance",
        0.0,
        "largest difference of stamps in one observation; 0 pairs equal stamps",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    timeout_s: float = parameter(
        "pairing_timeout",
        0.5,
        "an observation waits for a missing message until other topics' stamps are this much later",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """All parameters of the estimator node and of replay."""

    model: str = parameter("model", default="", description="name of an installed model or path of a file; empty: mars_rover")
    rover: str = parameter("rover", default="", description="name or file of the rover; empty takes the model's")
    core: CoreConfig = field(default_factory=CoreConfig)
    conversion: ConversionConfig = field(default_factory=ConversionConfig)
    pairing: PairingConfig = field(default_factory=PairingConfig)

    def sha256(self, rover_sha256: str = "") -> str:
        """Fingerprint of everything that changes the output, beside the model file, which has its own.

        Paths are left out: the same file in another folder gives the same estimates. ``rover_sha256`` stands for
        the contents of a rover file.
        """
        values = effective(self)
        del values["model"], values["rover"]
        return fingerprint(values | {"rover_sha256": rover_sha256})
