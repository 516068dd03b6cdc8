# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the nodes, defined once: they declare them, ``replay --params-file`` reads the estimator's."""

from dataclasses import dataclass, field

from rover_parameters.parameters import INLINE, effective, fingerprint
from rover_parameters.records import ConfigError, entry, number
from terrain_estimator.ros_types import BODY_FRAME, RECORDED_TOPICS


@dataclass(frozen=True, slots=True)
class CoreConfig:
    """What :class:`terrain_estimator.estimator.estimator.Estimator` takes: nothing of topics, stamps or frames."""

    use_torque: bool = entry("use the wheel torques of joint_states", default=True)
    use_imu: bool = entry("use pitch and acceleration of imu; else pitch of odom", default=True)
    use_moments: bool = entry(
        "use the moment balances of rover and bogie; they need the bogie's angle in joint_states",
        default=True,
    )
    prior_cohesion_mean_pa: float = number(
        "site knowledge: mean of the cohesion (with prior.cohesion_sd)",
        "Pa",
        0.0,
        1e6,
        default=0.0,
        key="prior.cohesion_mean",
    )
    prior_cohesion_sd_pa: float = number(
        "site knowledge: its standard deviation; 0 takes the model's prior",
        "Pa",
        0.0,
        1e6,
        default=0.0,
        key="prior.cohesion_sd",
    )
    prior_tan_phi_mean: float = number(
        "site knowledge: mean of tan phi (with prior.tan_phi_sd)",
        "1",
        0.0,
        5.0,
        default=0.0,
        key="prior.tan_phi_mean",
    )
    prior_tan_phi_sd: float = number(
        "site knowledge: its standard deviation; 0 takes the model's prior",
        "1",
        0.0,
        5.0,
        default=0.0,
        key="prior.tan_phi_sd",
    )
    prior_soil: str = entry(
        "site knowledge: name of the soil; empty takes all that the model knows for equally likely",
        "",
        key="prior.soil",
    )
    drift: float = number(
        "random walk of c and tan phi, in prior deviations per square root of a second of driving:"
        " forgets what is older; 0 takes the ground for constant between sharp changes",
        "1/sqrt(s)",
        0.0,
        1.0,
        default=0.0,
    )
    standstill_speed: float = number(
        "the rover stands where no wheel's rim is faster (the rover itself, where no wheel rate is"
        " measured)",
        "m/s",
        0.0,
        1.0,
        default=0.01,
    )
    gate_probability: float = number(
        "share of good observations that the gates may reject; 0 switches them off",
        "1",
        0.0,
        0.1,
        default=1e-5,
    )
    slip_minimum: float = number(
        "a wheel with less slip is left out; the model's range begins at -0.6",
        "1",
        -0.6,
        0.0,
        default=-0.6,
    )
    slip_maximum: float = number(
        "a wheel with this slip or more is left out; the model's range ends at 0.95",
        "1",
        0.0,
        0.95,
        default=0.95,
    )

    def __post_init__(self) -> None:
        """Refuse half a prior: a mean without its deviation would silently do nothing, a deviation alone put the mean at 0."""
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


@dataclass(frozen=True, slots=True)
class ConversionConfig:
    """How messages become an observation."""

    body_frame: str = entry(
        "frame_id of the measurements; empty accepts any", BODY_FRAME, empty=True
    )
    torque_relative_sd: float = number(
        "standard deviation of a measured wheel torque, as a fraction of it",
        "1",
        0.0,
        1.0,
        default=0.03,
        key="torque_noise.relative",
    )
    torque_absolute_sd: float = number(
        "standard deviation of a measured wheel torque, added in quadrature; 0 takes 1 % of 0.3 r m"
        " g / (number of wheels)",
        "N m",
        0.0,
        1e6,
        default=0.0,
        key="torque_noise.absolute",
    )
    bogie_joint: str = entry(
        "name of the bogie's joint, or of several by commas, in joint_states", "bogie"
    )
    bogie_nose_down: bool = entry(
        "the bogie's joint counts nose down as positive (a y axis as in REP-103); else nose up",
        default=False,
    )
    default_velocity_sd: float = number(
        "for odom without a twist variance; 0 refuses such an observation",
        "m/s",
        0.0,
        10.0,
        default=0.0,
        key="default_sd.velocity",
    )
    default_pitch_sd: float = number(
        "for a pitch without a variance; 0 refuses such an observation",
        "rad",
        0.0,
        1.0,
        default=0.0,
        key="default_sd.pitch",
    )
    default_acceleration_sd: float = number(
        "for imu without an acceleration variance; 0 leaves it out",
        "m/s^2",
        0.0,
        10.0,
        default=0.0,
        key="default_sd.acceleration",
    )


@dataclass(frozen=True, slots=True)
class PairingConfig:
    """How messages of several topics are paired by stamp."""

    tolerance_s: float = number(
        "largest difference of stamps in one observation; 0 pairs equal stamps",
        "s",
        0.0,
        1.0,
        default=0.0,
        key="pairing_tolerance",
    )
    timeout_s: float = number(
        "an observation waits for a missing message until other topics' stamps are this much later",
        "s",
        0.0,
        60.0,
        default=0.5,
        key="pairing_timeout",
    )


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """All parameters that change estimates: those of replay."""

    model: str = entry("name of an installed model or path of a file; empty: mars_rover", "")
    rover: str = entry("name or file of the rover; empty takes the model's", "")
    core: CoreConfig = field(default_factory=CoreConfig, metadata=INLINE)
    conversion: ConversionConfig = field(default_factory=ConversionConfig, metadata=INLINE)
    pairing: PairingConfig = field(default_factory=PairingConfig, metadata=INLINE)

    def sha256(self, rover_sha256: str = "") -> str:
        """Fingerprint of everything that changes the output, beside the model file, which has its own.

        Paths are left out: the same file in another folder gives the same estimates.
        ``rover_sha256`` stands for the contents of a rover file.
        """
        values = effective(self)
        del values["model"], values["rover"]
        return fingerprint(values | {"rover_sha256": rover_sha256})


_AUTO_START = "configure and activate at the start; else the services of a managed node do it"


@dataclass(frozen=True, slots=True)
class EstimatorNodeConfig:
    """All parameters of the estimator node: those of the estimates, and those of the process, which change no estimate."""

    estimator: EstimatorConfig = field(default_factory=EstimatorConfig, metadata=INLINE)
    auto_start: bool = entry(_AUTO_START, default=True)
    state_file: str = entry(
        "the state is kept in this file, and the node goes on from it when it is configured; empty:"
        " it is not kept",
        "",
        key="state.file",
    )
    autosave_period_s: float = number(
        "time between two writings of the state, by the steady clock",
        "s",
        0.1,
        3600.0,
        default=10.0,
        key="state.autosave_period",
    )


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """All parameters of the recorder node."""

    auto_start: bool = entry(_AUTO_START, default=True)

    output: str = entry(
        "folder of the bag, must not exist; empty: bags/<UTC time>, with -2, -3 where that is"
        " taken",
        "",
    )
    topics: str = entry(
        "names, as a list or separated by spaces; a relative name follows the namespace",
        " ".join(RECORDED_TOPICS),
    )
    fsync_interval_s: float = number(
        "what a power cut may cost; a kill costs nothing",
        "s",
        0.01,
        60.0,
        default=1.0,
        key="fsync_interval",
    )
    split_size_mb: float = number(
        "size of a file before it is compressed, beyond which the next one begins; 0: no limit",
        "MB",
        0.0,
        1e6,
        default=0.0,
        key="split.size",
    )
    split_duration_s: float = number(
        "span of log times in a file, beyond which the next one begins; 0: no limit",
        "s",
        0.0,
        1e6,
        default=0.0,
        key="split.duration",
    )


@dataclass(frozen=True, slots=True)
class WatchConfig:
    """All parameters of the watch node."""

    period_s: float = number(
        "time between two lines, by the wall clock", "s", 0.1, 3600.0, default=1.0, key="period"
    )
    report: str = entry(
        "file for rates and jitter at the end, as JSON; takes 8 bytes of memory a message; empty:"
        " none",
        "",
    )
    real_time_factor: float = number(
        "of the simulation, so that rates are those of simulated time",
        "1",
        0.01,
        1000.0,
        default=1.0,
    )


@dataclass(frozen=True, slots=True)
class AdviceConfig:
    """What :class:`terrain_estimator.planning.planner.Planner` takes."""

    slip_limit: float = number(
        "slip up to which a pull counts as available, and above which the rover is to stop",
        "1",
        0.1,
        0.9,
        default=0.6,
    )
    sinkage_limit: float = number(
        "mean sinkage above which the rover is to stop", "wheel radii", 0.01, 0.95, default=0.5
    )
    stop_probability: float = number(
        "probability of being stuck above which the rover is to stop",
        "1",
        0.001,
        0.999,
        default=0.5,
    )
    pull_deviation: float = number(
        "standard deviation of the pull beside that of c and tan phi, for soil constants and"
        " effects that nobody knows",
        "weights",
        0.0,
        1.0,
        default=0.015,
    )
    window_s: float = number(
        "time over which measurements are averaged, without outliers",
        "s",
        0.1,
        60.0,
        default=2.0,
        key="window",
    )
    reaction_s: float = number(
        "time from new ground under the front wheels to the brakes",
        "s",
        0.0,
        60.0,
        default=2.5,
        key="reaction_time",
    )
    deceleration: float = number("with which the rover stops", "m/s^2", 0.001, 10.0, default=0.2)
    standstill_speed: float = number(
        "the rover stands where no wheel's rim is faster, and creeps at twice that at least",
        "m/s",
        0.0,
        1.0,
        default=0.01,
    )


@dataclass(frozen=True, slots=True)
class PlannerConfig:
    """All parameters of the planner node."""

    model: str = entry(
        "name of an installed model or path of a file, as of the estimator; empty: mars_rover", ""
    )
    rover: str = entry("name or file of the rover; empty takes the model's", "")
    use_torque: bool = entry(
        "judge the ground of the front wheels by the wheel torques of joint_states", default=True
    )
    use_imu: bool = entry("use pitch of imu; else pitch of odom", default=True)
    period_s: float = number(
        "between the stamps of two pieces of advice", "s", 0.1, 60.0, default=0.5, key="period"
    )
    advice: AdviceConfig = field(default_factory=AdviceConfig, metadata=INLINE)
    pairing: PairingConfig = field(default_factory=PairingConfig, metadata=INLINE)


@dataclass(frozen=True, slots=True)
class SlipSourceConfig:
    """All parameters of the slip source node."""

    rover: str = entry(
        "name or file of the rover: wheel radius, names and order of the wheels", "mars_rover"
    )
    velocity_type: str = entry(
        "message of the velocity: odometry (nav_msgs) or twist"
        " (geometry_msgs/TwistWithCovarianceStamped)",
        "odometry",
    )
    body_frame: str = entry(
        "frame_id of the velocity, and of what is published; empty accepts any and publishes"
        f" {BODY_FRAME}",
        BODY_FRAME,
        empty=True,
    )
    standstill_speed: float = number(
        "a wheel stands where its rim is slower; its slip is NaN", "m/s", 0.0, 1.0, default=0.01
    )
    radius_sd: float = number(
        "relative standard deviation of the rolling radius",
        "1",
        0.0,
        1.0,
        default=0.01,
        key="radius_deviation",
    )
    rate_sd: float = number(
        "standard deviation of a wheel rate", "rad/s", 0.0, 10.0, default=0.0, key="rate_deviation"
    )
    default_velocity_sd: float = number(
        "for a velocity without a variance; 0 refuses it",
        "m/s",
        0.0,
        10.0,
        default=0.0,
        key="default_sd.velocity",
    )
    tolerance_s: float = number(
        "largest difference of stamps of a wheel rate and a velocity; 0 pairs equal stamps",
        "s",
        0.0,
        1.0,
        default=0.02,
        key="pairing_tolerance",
    )


@dataclass(frozen=True, slots=True)
class MapConfig:
    """All parameters of the map node."""

    spacing_m: float = number(
        "least distance of two points", "m", 0.0, 1000.0, exclusive=True, default=0.1, key="spacing"
    )
    points: int = number(
        "most points: when there are more, every second one goes and the spacing doubles",
        "1",
        2,
        1_000_000,
        default=5000,
    )
    period_s: float = number(
        "between the stamps of two clouds", "s", 0.0, 3600.0, default=1.0, key="period"
    )
    tolerance_s: float = number(
        "largest difference of stamps of an estimate and its odometry; 0 pairs equal stamps",
        "s",
        0.0,
        1.0,
        default=0.0,
        key="pairing_tolerance",
    )


@dataclass(frozen=True, slots=True)
class ShownConfig:
    """What :class:`terrain_estimator.dashboard.model.LiveModel` takes."""

    window_s: float = number(
        "length of the recent history that the page shows in full",
        "s",
        1.0,
        3600.0,
        default=120.0,
        key="window",
    )
    points: int = number(
        "most rows of the recent history, and of that of the whole drive, each",
        "1",
        10,
        5000,
        default=600,
    )


@dataclass(frozen=True, slots=True)
class DashboardConfig:
    """All parameters of the dashboard node."""

    port: int = number(
        "TCP port of the page; 0 takes a free one, which the log names", "1", 0, 65535, default=8090
    )
    address: str = entry(
        "address to listen on; 127.0.0.1: this machine alone, 0.0.0.0: whoever reaches it,"
        " unprotected",
        "127.0.0.1",
    )
    rate: float = number(
        "at which the page is brought up to date, at most", "Hz", 1.0, 20.0, default=5.0
    )
    shown: ShownConfig = field(default_factory=ShownConfig, metadata=INLINE)
