# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The knowledge before any measurement: the rover, the spread of ground and of soil constants."""

from dataclasses import dataclass

from rover_parameters.records import number


@dataclass(frozen=True, slots=True)
class Prior:
    """Means and standard deviations before any measurement."""

    cohesion_pa: float = number("prior mean of the cohesion", "Pa")
    cohesion_sd_pa: float = number(
        "prior standard deviation of the cohesion", "Pa", 0.0, exclusive=True
    )
    tan_phi: float = number("prior mean of the tangent of the friction angle")
    tan_phi_sd: float = number("prior standard deviation of tan phi", "1", 0.0, exclusive=True)
    mass_sd: float = number(
        "standard deviation of the rover's mass, relative to the rover file's",
        "1",
        0.0,
        exclusive=True,
    )
    centre_of_mass_sd: float = number(
        "standard deviation of the centre of mass along the body", "m", 0.0, exclusive=True
    )
    acceleration_bias_sd: float = number(
        "standard deviation of the imu's acceleration bias", "m/s^2", 0.0, exclusive=True
    )
    constants_sd: float = number(
        "relative standard deviation of each soil constant; 0 makes them exact", "1", 0.0
    )
    ground_variation: float = number(
        "relative standard deviation of the ground's strength and stiffness from axle to axle; 0"
        " makes it the same everywhere",
        "1",
        0.0,
        default=0.0,
    )


DEFAULT_PRIOR = Prior(
    cohesion_pa=2750.0,
    cohesion_sd_pa=1300.0,
    tan_phi=0.6,
    tan_phi_sd=0.22,
    acceleration_bias_sd=0.02,
    mass_sd=0.01,
    centre_of_mass_sd=0.02,
    constants_sd=0.05 / 3**0.5,
)
"""The prior of a training without another one, and of a search without a model.

Mean and deviation of the benchmarks' draws: c uniform in 0.5 to 5 kPa, phi in 15 to 45 deg,
constants within 5 %.
"""
