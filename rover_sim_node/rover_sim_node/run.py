# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate one drive with its measurements, step by step, without ROS."""

import dataclasses
import math

import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from rover_sim_node.config import FOLLOW, SimulatorConfig
from rover_sim_node.reading import FIXED, GroundTruth, MotionAcross, SimulatedReading, single
from rover_sim_node.true_tracks import tracks_of
from rover_sim_node.velocity_commands import VelocityCommands
from terramechanics.effects import describe, make_effect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import Measurement, Sample
from terramechanics.simulation.schedules import PROFILES, SCHEDULES
from terramechanics.simulation.sensors import Noise, acceleration_bias, measure, per_wheel
from terramechanics.simulation.simulation import start
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.profile import Profile, Ramp, StepProfile
from terramechanics.terrain.soil import LINEAR_STRESS
from terramechanics.vehicle.rover import Rover


class SimulatedRun:
    """A drive of one rover; the same configuration and commands give the same readings."""

    @torch.inference_mode()
    def __init__(self, config: SimulatorConfig) -> None:
        """Set up the drive. Raises ConfigError that names a wrong parameter."""
        for name in ("cross_slope", "yaw_inertia"):
            if getattr(config, name):
                raise ConfigError(
                    f"parameter {name}: {getattr(config, name):g} does nothing on a rover that"
                    " drives straight: set steering"
                )
        self.rover = load_rover(config.rover)
        self.config = config
        self._ground = _ground(config, self.rover.wheel_width)
        if config.effect and self._ground.law == LINEAR_STRESS:
            raise ConfigError(
                f"parameter effect: {config.effect} is not simulated on soils of law"
                f" {LINEAR_STRESS}: leave it out, or give a soil of another law"
            )
        self._noise = Noise(factor=config.noise)
        drive, self._sensing = torch.Generator(), torch.Generator()
        # Sensors have a generator of their own, so that their noise does not depend on what the
        # drive draws.
        drive.manual_seed(2 * config.seed)
        self._sensing.manual_seed(2 * config.seed + 1)
        self.commands = VelocityCommands(self.rover, config) if config.schedule == FOLLOW else None
        if self.commands is None and config.schedule not in SCHEDULES:
            raise ConfigError(
                f"parameter schedule: {config.schedule!r} is unknown, give one of"
                f" {', '.join(SCHEDULES)}, {FOLLOW}"
            )
        schedule = self.commands or config.schedule
        self._step = 1.0 / config.rate
        self._simulation, self._schedule = start(
            self.rover,
            self._ground,
            schedule,
            drive,
            1,
            _profile(config),
            self._step,
            plant_of(config, self.rover),
        )
        self._bias = acceleration_bias(self._noise, 1, self._sensing)
        self._wheel_angle = torch.zeros(len(self.rover.wheels), dtype=torch.float64)
        self._tracks = tracks_of(config.sinkage_reference, self.rover, self.rover.reach)
        self._odometry, self._variance = (0.0, 0.0), (0.0, 0.0)
        self._bogie_angle = math.nan

    @torch.inference_mode()  # a fifth less time: nothing here is differentiated
    def step(self) -> SimulatedReading:
        """Simulate one step; return its reading."""
        time = (self._simulation.steps + 1) * self._step
        sample = self._simulation.step(self._schedule.kind, self._schedule.command(time))
        sensed = self._simulation.sensed(self._reported(sample))
        measured = single(
            measure(
                self.rover,
                per_wheel(self.rover, sensed),
                self._noise,
                self._bias,
                self._sensing,
            )
        )
        self._wheel_angle = self._wheel_angle + self._step * measured.wheel_rate
        self._integrate(measured)
        angle = float(sample.bogie_angle)
        rate = 0.0 if math.isnan(self._bogie_angle) else (angle - self._bogie_angle) / self._step
        self._bogie_angle = angle
        return SimulatedReading(
            time=time,
            rover=self.rover,
            measured=measured,
            wheel_angle=self._wheel_angle,
            across=self._across(sample),
            bogie_angle=angle,
            bogie_rate=rate,
            ground_force=self._ground_force(sample),
            odometry=(self._odometry[0], 0.0, self._odometry[1]),
            odometry_variance=(self._variance[0], FIXED, self._variance[1]),
            truth=self._truth(sample),
            position=float(sample.position),
            stuck=bool(sample.stuck),
            specific_force=(0.0, self.rover.gravity * math.cos(float(measured.pitch))),
        )

    def _reported(self, sample: Sample) -> Sample:
        """Return the sample with sinkages from the ground that sensors measure them from."""
        if self._tracks is None:
            return sample
        places = torch.stack([sample.contact, torch.zeros_like(sample.contact)], -1)
        ahead = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
        local = self._tracks.local(places, sample.sinkage, ahead)
        return dataclasses.replace(sample, sinkage=local)

    def _across(self, sample: Sample) -> MotionAcross:
        axles = list(self.rover.wheel_axle)
        rim = self.rover.wheel_radius * sample.wheel_rate[0, axles]
        along = rim * (1.0 - sample.slip[0, axles])
        return MotionAcross.of(rim, along, torch.zeros_like(rim))

    def _ground_force(self, sample: Sample) -> Tensor:
        none = torch.zeros_like(sample.normal)  # to a side
        values = torch.stack([sample.normal, sample.traction, sample.contact_angle, none], -1)
        return values[0, list(self.rover.wheel_axle)]

    def _integrate(self, measured: Measurement) -> None:
        """Add one step of dead reckoning; errors of steps are independent, so variances add."""
        velocity, pitch = float(measured.velocity), float(measured.pitch)
        along, up = self._step * velocity * math.cos(pitch), self._step * velocity * math.sin(pitch)
        spread, tilt = float(measured.velocity_sd), float(measured.pitch_sd)
        self._odometry = (self._odometry[0] + along, self._odometry[1] + up)
        by_x = (self._step * spread * math.cos(pitch)) ** 2 + (up * tilt) ** 2
        by_z = (self._step * spread * math.sin(pitch)) ** 2 + (along * tilt) ** 2
        self._variance = (self._variance[0] + by_x, self._variance[1] + by_z)

    def _truth(self, sample: Sample) -> GroundTruth:
        middle = sample.contact.shape[1] // 2
        place = float(sample.contact[0, middle])
        patch = self._ground.patches[self._ground.patch_at(place)]
        constants, strength = (
            sample.constants[0, middle].tolist(),
            sample.strength[0, middle].tolist(),
        )
        blending = place < patch.start + patch.transition
        return GroundTruth(
            patch.name,
            place if blending else patch.start + patch.transition,
            tuple(constants),
            (strength[0], strength[1]),
        )


def _ground(config: SimulatorConfig, width: float) -> Ground:
    first = load_soil(config.soil).with_values(**config.soil_overrides.given())
    patches = [Patch.of(first.for_wheel(width))]
    if config.change.soil:
        second = load_soil(config.change.soil).for_wheel(width)
        if second.law != first.law:
            raise ConfigError(
                f"parameter change.soil: {second.name} has law {second.law}, {first.name} before it"
                f" {first.law}: give soils of one law"
            )
        patches.append(Patch.of(second, config.change.position, config.change.transition))
    return Ground(patches)


def plant_of(config: SimulatorConfig, rover: Rover) -> Plant | None:
    """Return the effect that a drive has; None for none.

    Raises ConfigError for a parameter of it that is wrong.
    """
    if not config.effect:
        if config.effect_size and not math.isnan(config.effect_size):
            raise ConfigError(
                f"parameter effect_size: {config.effect_size:g} does nothing without a name: set"
                " effect"
            )
        return None
    given = not math.isnan(config.effect_size)
    try:
        description = describe(config.effect)
        size = description.checked(config.effect_size) if given else description.high
        if description.planar or not config.steering:
            effect = make_effect(config.effect, size, config.effect_axle)
        else:
            effect = description.acting(description.values(size))
    except ConfigError as error:
        raise ConfigError(f"parameters of the effect: {error}") from error
    if description.by_axle and config.effect_axle >= rover.axles:
        raise ConfigError(
            f"parameter effect_axle: {config.effect_axle} is none of the {rover.axles} axles of"
            f" {rover.name}: give 0 to {rover.axles - 1}"
        )
    if not given:
        raise ConfigError(
            f"parameter effect_size: give the size of {config.effect},"
            f" {description.low:g} to {description.high:g} [{description.unit}]; without one the"
            " effect does not act"
        )
    return Plant([effect])


def _profile(config: SimulatorConfig) -> str | Profile:
    if config.profile == "ramp":
        return Ramp(config.ramp_grade)
    if config.profile == "step":
        return StepProfile(config.step_rise)
    if config.profile not in ("", *PROFILES):
        raise ConfigError(
            f"parameter profile: {config.profile!r} is unknown, give one of {', '.join(PROFILES)},"
            " ramp, step or nothing"
        )
    return config.profile
