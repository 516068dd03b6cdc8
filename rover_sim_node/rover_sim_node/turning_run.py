# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate a rover that turns on a slope or over hills, with its measurements, without ROS.

Every wheel has its own place, slip, sinkage and torque. The body is that of the rover file, with a
distance between left and right.
"""

import math
from dataclasses import replace

import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from rover_sim_node.config import FOLLOW, FOLLOW_WHEELS, SimulatorConfig
from rover_sim_node.reading import (
    FIXED,
    FIXED_SD,
    GroundTruth,
    MotionAcross,
    SidewaysMotion,
    SimulatedReading,
    single,
)
from rover_sim_node.run import plant_of
from rover_sim_node.true_tracks import tracks_of
from rover_sim_node.twist_commands import SKID, TwistCommands, check_steering
from rover_sim_node.wheel_commands import WheelCommands
from terramechanics.description.layout import track_width_of
from terramechanics.effects import EFFECTS, Description
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.sample import SLOWEST, Measurement, Sample
from terramechanics.simulation.sensors import (
    LATERAL_SD,
    YAW_RATE_SD,
    Noise,
    acceleration_bias,
    measure,
)
from terramechanics.simulation.simulation import STUCK_TIME
from terramechanics.simulation.spatial import BodySample, BodySimulation, Plane
from terramechanics.terrain.profile import STEEPEST
from terramechanics.terrain.soil import WONG_REECE
from terramechanics.terrain.surface import Level, Surface, random_waves
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.suspension import TerrainError
from terramechanics.vehicle.wheel_places import box_inertia, chassis_places

NO_PROGRESS = 0.1
"""[1] Share of the rims' speed below which a rover makes no progress."""


class TurningRun:
    """A drive of one rover; the same configuration and commands give the same readings."""

    @torch.inference_mode()
    def __init__(self, config: SimulatorConfig) -> None:
        """Set up the drive. Raises ConfigError that names a wrong parameter."""
        _check(config)
        self.rover, self.config = load_rover(config.rover), config
        track = track_width_of(self.rover, config.track_width)
        chassis = Chassis.of(
            self.rover, track, config.yaw_inertia or box_inertia(self.rover, track)
        )
        soil = load_soil(config.soil).with_values(**config.soil_overrides.given())
        if soil.law != WONG_REECE:
            raise ConfigError(
                f"parameter soil: {soil.name} has law {soil.law}, under which a rover that turns is"
                f" not simulated: give one of law {WONG_REECE}, or leave steering out"
            )
        soil = soil.for_wheel(self.rover.wheel_width)
        self.commands = TwistCommands(chassis, config)
        self.wheel_commands = (
            WheelCommands(self.rover, config) if config.schedule == FOLLOW_WHEELS else None
        )
        self._truth = GroundTruth(
            soil.name, 0.0, tuple(soil.constants().tolist()), (soil.cohesion, soil.tan_phi)
        )
        uphill = math.tan(config.ramp_grade) if config.profile == "ramp" else 0.0
        self._step = 1.0 / config.rate
        plant = plant_of(config, self.rover)
        self._effects = None if plant is None else BodyPlant(plant, self.rover)
        self._constants, self._strength = soil.constants(), soil.strength()
        self._simulation = BodySimulation(
            chassis,
            self._constants.unsqueeze(0),
            self._strength.unsqueeze(0),
            Plane(uphill, math.tan(config.cross_slope)),
            time_step=self._step,
            surface=_surface(config),
            effects=self._effects,
        )
        self._tracks = tracks_of(config.sinkage_reference, self.rover, chassis.reach)
        self._places = chassis_places(self.rover)
        self._noise, self._sensing = Noise(factor=config.noise), torch.Generator()
        self._sensing.manual_seed(2 * config.seed + 1)
        # of the accelerometers along x, y and z
        self._bias = acceleration_bias(self._noise, 3, self._sensing)
        self._wheel_angle = torch.zeros(len(self.rover.wheels), dtype=torch.float64)
        self._velocity = torch.zeros(3, dtype=torch.float64)
        self._pose, self._height = torch.zeros(3, dtype=torch.float64), 0.0
        self._spread = torch.zeros(3, 3, dtype=torch.float64)  # covariance of x, y and yaw
        self._bogie_angle = math.nan
        self._height_variance, self._no_progress, self._gone = 0.0, 0.0, 0.0

    @torch.inference_mode()
    def step(self) -> SimulatedReading:
        """Simulate one step; return its reading. Raises TerrainError where it has no solution."""
        time = (self._simulation.steps + 1) * self._step
        body = self._simulation.step(*(self.wheel_commands or self.commands).command(time))
        if not bool(body.solved):
            raise TerrainError(
                f"{self.rover.name}: no wheel loads balance after {time:g} s: the slope is too"
                f" steep, or the ground too soft{self._with_effect}"
            )
        sample = self._sample(body)
        reported = self._reported(sample, body)
        sensed = reported if self._effects is None else self._effects.sensed(reported)
        measured = single(measure(self.rover, sensed, self._noise, self._bias[:1], self._sensing))
        self._wheel_angle = self._wheel_angle + self._step * measured.wheel_rate
        moved = self._integrated(measured, self._sideways(body, float(measured.pitch)))
        force = self._felt(body)
        bogie = self._bogie(body)
        rate = 0.0 if math.isnan(self._bogie_angle) else (bogie - self._bogie_angle) / self._step
        self._bogie_angle = bogie
        self._gone += self._step * float(body.velocity[0, :2].norm())
        self._velocity = body.velocity[0]
        variances = (*self._spread.diagonal()[:2].tolist(), self._height_variance)
        return SimulatedReading(
            time=time,
            rover=self.rover,
            measured=measured,
            wheel_angle=self._wheel_angle,
            across=MotionAcross.of(
                *(each[0, self._places] for each in (body.rim, body.along, body.across))
            ),
            bogie_angle=bogie,
            bogie_rate=rate,
            ground_force=_ground_force(sample, body.forces[:, self._places, 3]),
            odometry=(float(self._pose[0]), float(self._pose[1]), self._height),
            odometry_variance=(
                max(variances[0], FIXED),
                max(variances[1], FIXED),
                max(variances[2], FIXED),
            ),
            truth=self._truth,
            position=self._gone,
            stuck=self._is_stuck(body),
            sideways=moved,
            specific_force=force,
            steering=None if self.config.steering == SKID else body.steering[0, self._places],
        )

    @property
    def _with_effect(self) -> str:
        effect = self.config.effect
        return f", with {effect} of {self.config.effect_size:g}" if effect else ""

    def _sample(self, body: BodySample) -> Sample:
        """Return the true values, with those of every wheel in the order of the rover file."""
        rim = body.rim[:, self._places]
        slip = torch.where(rim.abs() > SLOWEST, 1.0 - body.along[:, self._places] / rim, math.nan)
        forces, level = body.forces[:, self._places], torch.zeros_like(slip)
        return Sample(
            time=body.time,
            position=body.position[:, 0],
            height=level[:, 0],
            velocity=body.velocity[:, 0],
            acceleration=self._acceleration(body)[:1],
            pitch=body.pitch,
            bogie_angle=level[:, 0] + self._bogie(body),
            stuck=level[:, 0] > 0.0,
            standing=(rim.abs() <= SLOWEST).all(-1),
            slip=slip,
            sinkage=body.sinkage[:, self._places],
            contact=level,
            contact_angle=body.contact_angle[:, self._places],
            wheel_rate=rim / self.rover.wheel_radius,
            torque=body.torque[:, self._places],
            normal=forces[..., 0],
            traction=forces[..., 1],
            ground_torque=forces[..., 2],
            valid=torch.isfinite(slip),
            constants=self._constants.expand(*slip.shape, 6),
            strength=self._strength.expand(*slip.shape, 2),
        )

    def _reported(self, sample: Sample, body: BodySample) -> Sample:
        """Return the sample with sinkages from the ground that sensors measure them from."""
        if self._tracks is None:
            return sample
        turned = torch.stack([body.heading.cos(), body.heading.sin()], -1)
        places = self._simulation.wheel_places()
        local = self._tracks.local(places, body.sinkage, turned)
        return replace(sample, sinkage=local[:, self._places])

    def _bogie(self, body: BodySample) -> float:
        """Return the mean angle of the bogies left and right [rad], 0 without bogies."""
        if not self.rover.suspension:
            return 0.0
        return float(body.joints[0, :2].mean())

    def _acceleration(self, body: BodySample) -> Tensor:
        """Return the acceleration [2] [m/s^2] along the body's x and y, of the centre of mass."""
        along, left, turn = self._velocity.unbind()
        sine, cosine = torch.sin(turn * self._step), torch.cos(turn * self._step)
        before = torch.stack([cosine * along + sine * left, cosine * left - sine * along])
        return (body.velocity[0, :2] - before) / self._step

    def _felt(self, body: BodySample) -> tuple[float, float]:
        """Measure the specific force [m/s^2] along the body's y and z."""
        drawn = torch.randn(2, generator=self._sensing, dtype=torch.float64)
        true = torch.stack([self._acceleration(body)[1], torch.zeros(())]) - body.gravity[0, 1:]
        noise = self._noise.factor * self._noise.acceleration * drawn
        left, up = (true + self._bias[1:] + noise).tolist()
        return left, up

    def _sideways(self, body: BodySample, pitch: float) -> SidewaysMotion:
        """Measure the motion of the body's origin that a planar rover does not make."""
        drawn = torch.randn(3, generator=self._sensing, dtype=torch.float64).tolist()
        factor, turn = self._noise.factor, float(body.velocity[0, 2])
        left = float(body.velocity[0, 1]) - self.rover.centre_of_mass_x * turn
        # what an inertial unit calls roll is about the axis that the pitch has tilted
        roll = math.asin(math.sin(float(body.roll)) / math.cos(float(body.pitch)))
        rate = turn + factor * YAW_RATE_SD * drawn[1]
        roll += factor * self._noise.pitch * drawn[2]
        return SidewaysMotion(
            lateral_velocity=left + factor * LATERAL_SD * drawn[0],
            lateral_velocity_sd=_stated(factor, LATERAL_SD),
            yaw_rate=rate,
            yaw_rate_sd=_stated(factor, YAW_RATE_SD),
            roll=roll,
            roll_sd=_stated(factor, self._noise.pitch),
            yaw=float(self._pose[2]) + self._step * rate * math.cos(roll) / math.cos(pitch),
        )

    def _integrated(self, measured: Measurement, moved: SidewaysMotion) -> SidewaysMotion:
        """Add a step of dead reckoning, and of its covariance to first order; return the motion.

        The step goes along the yaw in its middle.
        """
        step, lateral = self._step, moved.lateral_velocity
        ahead, ahead_sd = float(measured.velocity), float(measured.velocity_sd)
        tilt, tilt_sd = float(measured.pitch), float(measured.pitch_sd)
        rising, level = math.sin(moved.roll), math.cos(moved.roll)
        along = ahead * math.cos(tilt) - lateral * rising * math.sin(tilt)
        left, yaw = lateral * level, 0.5 * (float(self._pose[2]) + moved.yaw)
        sine, cosine = math.sin(yaw), math.cos(yaw)
        way = [cosine * along - sine * left, sine * along + cosine * left]
        by = torch.eye(3, dtype=torch.float64)
        by[0, 2], by[1, 2] = -step * way[1], step * way[0]
        spreads = [
            math.hypot(cosine * ahead_sd, sine * moved.lateral_velocity_sd),
            math.hypot(sine * ahead_sd, cosine * moved.lateral_velocity_sd),
            moved.yaw_rate_sd,
        ]
        noise = torch.diag(torch.tensor(spreads, dtype=torch.float64).square())
        self._spread = by @ self._spread @ by.T + step**2 * noise
        pose = [*(self._pose[:2] + step * torch.tensor(way)).tolist(), moved.yaw]
        self._pose = torch.tensor(pose, dtype=torch.float64)
        self._height += step * (ahead * math.sin(tilt) + lateral * rising * math.cos(tilt))
        self._height_variance += step**2 * (
            (ahead * tilt_sd) ** 2
            + (ahead_sd * math.sin(tilt)) ** 2
            + (lateral * level * math.cos(tilt) * moved.roll_sd) ** 2
            + (moved.lateral_velocity_sd * rising * math.cos(tilt)) ** 2
        )
        return replace(moved, yaw_sd=max(float(self._spread[2, 2].sqrt()), FIXED_SD))

    def _is_stuck(self, body: BodySample) -> bool:
        """Return whether the wheels have turned for STUCK_TIME and the hubs have not moved on.

        A rover that slides back makes no progress either.
        """
        rim, hub = float(body.rim.abs().mean()), float((body.along * body.rim.sign()).mean())
        held = rim > 2.0 * SLOWEST and hub < NO_PROGRESS * rim
        self._no_progress = self._no_progress + self._step if held else 0.0
        return self._no_progress >= STUCK_TIME


def _surface(config: SimulatorConfig) -> Surface:
    if config.profile != "hills":
        return Level()
    generator = torch.Generator().manual_seed(2 * config.seed)
    return random_waves(1, STEEPEST, generator)


def _acts_in_turns(effect: Description) -> bool:
    """Return whether an effect is simulated where a rover turns."""
    return not effect.by_axle and not effect.law.keeps_ruts


def _check(config: SimulatorConfig) -> None:
    """Refuse what is simulated for rovers that drive straight alone."""
    check_steering(config)
    why = f"with steering {config.steering}"
    if config.schedule not in {FOLLOW, FOLLOW_WHEELS}:
        raise ConfigError(
            f"parameter schedule: {config.schedule} drives straight ahead; {why} give {FOLLOW} or"
            f" {FOLLOW_WHEELS}"
        )
    if config.profile not in ("", "flat", "ramp", "hills"):
        raise ConfigError(
            f"parameter profile: {config.profile} is not simulated {why}: give flat, ramp or hills"
        )
    if config.effect in EFFECTS and not _acts_in_turns(EFFECTS[config.effect]):
        raise ConfigError(
            f"parameter effect: {config.effect} is not simulated {why}: give one of"
            f" {', '.join(name for name, each in EFFECTS.items() if _acts_in_turns(each))}"
        )
    if config.change.soil:
        raise ConfigError(
            f"parameter change.soil: {config.change.soil} is not simulated {why}: leave it out"
        )


def _ground_force(sample: Sample, lateral: Tensor) -> Tensor:
    """Return the forces [wheels, 4] of the ground, as SimulatedReading has them."""
    return torch.stack([sample.normal, sample.traction, sample.contact_angle, lateral], -1)[0]


def _stated(factor: float, deviation: float) -> float:
    """Return the deviation that a sensor states; none is zero, which would mean unknown."""
    return max(factor, 1e-3) * deviation
