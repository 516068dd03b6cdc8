# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the configured sensors tell of tan phi, by the estimator's own posterior of a known drive.

A set of sensors is judged by information, not by its rows: the estimator that is to run takes a
reference drive on each soil with the sensors, noise and limits of its configuration. The inverse
variance that the data add to the prior's is the Fisher information of tan phi, with the priors of
all else (c, soil constants, rover) in. Its root's inverse is the Cramer-Rao bound.

The prior of c stays in: where hardly anything depends on c, as on compact sand, its spread decides
nothing about tan phi.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import ConversionConfig, EstimatorConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.observation import Observation

LARGEST_BOUND = 0.8
"""[prior deviations] Bound of tan phi beyond which the prior decides more than the sensors."""

Drives = Mapping[str, Sequence[Observation]]
"""A measured reference drive for each soil, by its name."""


class SensorBounds(NamedTuple):
    """Bounds of tan phi after the reference drives."""

    bounds: dict[str, float]  # [prior deviations] by soil; inf: the data add nothing
    seconds: float  # [s] length of a drive

    @property
    def poor(self) -> list[str]:
        """Return the soils on which the bound is too large."""
        return [soil for soil, bound in self.bounds.items() if bound > LARGEST_BOUND]

    @property
    def largest(self) -> float:
        """Return the largest bound [prior deviations]; NaN where nothing was checked."""
        return max(self.bounds.values(), default=math.nan)


def bounds_of(model: LoadedModel, config: EstimatorConfig, drives: Drives) -> SensorBounds:
    """Return what the configured sensors tell on the soils that the model knows.

    A drive ends where the bound is small enough: data add information.

    Site knowledge and forgetting are left out: they are no sensors.
    """
    plain = dataclasses.replace(
        config.core,
        prior_cohesion_mean_pa=0.0,
        prior_cohesion_sd_pa=0.0,
        prior_tan_phi_mean=0.0,
        prior_tan_phi_sd=0.0,
        forgetting_time=0.0,
    )
    noise = config.conversion.of_model(by_wheel=bool(model.metadata.wheels))
    known = [soil.name for soil in model.metadata.soils]
    asked = [config.core.prior_soil] if config.core.prior_soil else known
    bounds, length = {}, 0
    for soil in asked:
        if soil in drives:
            estimator = Estimator(model, dataclasses.replace(plain, prior_soil=soil))
            measured = [_with_noise(each, noise) for each in drives[soil]]
            bounds[soil], length = _bound(estimator, model, measured), len(measured)
    return SensorBounds(bounds, length * model.metadata.step_s)


def _bound(estimator: Estimator, model: LoadedModel, drive: Sequence[Observation]) -> float:
    """Return the bound of tan phi [prior deviations] after a drive, or where it is small enough."""
    prior, bound = float(model.metadata.prior_sd[1]), math.inf
    for index, observation in enumerate(drive, 1):
        update = estimator.update(observation)
        if index % model.metadata.block == 0:
            share = float(update.estimate.covariance[1][1]) / prior**2  # of the prior's variance
            # rounding may leave a share just off 1 where the data add nothing
            bound = (1.0 / share - 1.0) ** -0.5 if 0.0 < share < 1.0 - 1e-9 else math.inf
            if bound <= LARGEST_BOUND:
                break
    return bound


def _with_noise(observation: Observation, config: ConversionConfig) -> Observation:
    """Return an observation with the deviations that the configuration states.

    The drives have those of a configuration that states none.
    """
    usual = (ConversionConfig().torque_relative_sd * observation.torque) ** 2
    constant = config.torque_absolute_sd**2 or np.maximum(observation.torque_sd**2 - usual, 0.0)
    relative = (config.torque_relative_sd * observation.torque) ** 2
    return dataclasses.replace(
        observation,
        torque_sd=np.sqrt(relative + constant),
        velocity_sd=config.default_velocity_sd or observation.velocity_sd,
        pitch_sd=config.default_pitch_sd or observation.pitch_sd,
        acceleration_sd=config.default_acceleration_sd or observation.acceleration_sd,
        lateral_velocity_sd=config.default_lateral_velocity_sd or observation.lateral_velocity_sd,
        yaw_rate_sd=config.default_yaw_rate_sd or observation.yaw_rate_sd,
    )


def doubt_of(
    sensors: SensorBounds, config: EstimatorConfig, *, velocity_alone: bool = False
) -> str:
    """Return a warning where the sensors tell too little on some soils; empty where on none.

    Raises ConfigError where they do on every soil, unless site knowledge says what tan phi is, or
    the model is of the velocity row alone: its data are no drives that balance loads.
    """
    if not sensors.poor:
        return ""
    numbers = ", ".join(f"{_number(sensors.bounds[soil])} on {soil}" for soil in sensors.poor)
    found = (
        f"in a reference drive of {sensors.seconds:g} s the bound of tan phi, at most"
        f" {LARGEST_BOUND:g} of the prior's deviation, is {numbers}; {_named(config)}"
    )
    if len(sensors.poor) < len(sensors.bounds):
        return f"on some soils these sensors leave the ground to the prior: {found}"
    if velocity_alone:
        return (
            "the velocity alone leaves the ground to the prior where sinkages carry the load; data"
            f" with other slips and sinkages may tell more: {found}"
        )
    if config.core.prior_tan_phi_sd:
        return f"these sensors leave the ground to your prior.tan_phi_mean: {found}"
    raise ConfigError(
        f"these sensors leave the ground to the prior: {found}: switch a sensor on, state less"
        " noise where a sensor has less, or say what the ground is by prior.tan_phi_mean and"
        " prior.tan_phi_sd"
    )


def _number(bound: float) -> str:
    return f"{bound:.2g}" if math.isfinite(bound) else "infinite"


def _named(config: EstimatorConfig) -> str:
    """Return the parameters that leave a sensor out or state its noise, with their values."""
    core, plain = config.core, type(config.core)()
    said = [
        f"{name}: false"
        for name in ("use_torque", "use_imu", "use_moments", "use_sinkage")
        if not getattr(core, name)
    ]
    said += [
        f"{name}: {getattr(core, name):g}"
        for name in ("standstill_speed", "slip_minimum", "slip_maximum")
        if getattr(core, name) != getattr(plain, name)
    ]
    noise, usual = config.conversion, type(config.conversion)()
    names = {
        "torque_relative_sd": "torque_noise.relative",
        "torque_absolute_sd": "torque_noise.absolute",
        "default_velocity_sd": "default_sd.velocity",
        "default_pitch_sd": "default_sd.pitch",
        "default_acceleration_sd": "default_sd.acceleration",
        "default_lateral_velocity_sd": "default_sd.lateral_velocity",
        "default_yaw_rate_sd": "default_sd.yaw_rate",
    }
    said += [
        f"{key}: {getattr(noise, name):g}"
        for name, key in names.items()
        if getattr(noise, name) != getattr(usual, name)
    ]
    return f"the configuration has {', '.join(said) or 'the default sensors'}"
