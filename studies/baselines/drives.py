# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Input of every method: a batch of drives on level ground, as the paper's rover measures them."""

from dataclasses import dataclass, fields
from typing import Protocol

import torch
from torch import Tensor

from terramechanics.contact.stresses import quadrature, wheel_forces, wheel_forces_linear_stress

PA_PER_UNIT = 1000.0
"""c is carried in kPa, so that both parameters are of order one."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Properties of a planar rover in the equation of motion."""

    mass_kg: float
    wheels_per_axle: int
    radius_m: float
    width_m: float
    step_s: float


@dataclass(frozen=True, slots=True)
class LevelDrives:
    """Drives: wheels [batch, time, axles], body [batch, time]. Sample j holds over (t_(j-1), t_j].

    ``slip`` and ``sinkage`` are measured, with standard deviations; torque and load of one wheel
    are true, as the paper hands them to Iagnemma's method, the torque being also the commanded
    input. ``velocity`` has one more sample, t_0.
    """

    slip: Tensor
    slip_sd: Tensor
    sinkage: Tensor  # [m]
    sinkage_sd: Tensor
    torque: Tensor  # [N m]
    load: Tensor  # [N]
    velocity: Tensor  # [batch, time + 1] measured [m/s]
    velocity_sd: Tensor  # [] its standard deviation
    true_velocity: Tensor  # [batch, time + 1]
    true_slip: Tensor
    true_sinkage: Tensor
    strength: Tensor  # [batch, 2] true c [Pa], tan phi
    true_constants: Tensor  # [batch, 6] of the ground

    def subset(self, index: Tensor) -> "LevelDrives":
        """The drives of that index or mask."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return LevelDrives(
            **{name: value if value.ndim == 0 else value[index] for name, value in values.items()}
        )

    @property
    def increment(self) -> Tensor:
        """Measured change of velocity of every sample, [batch, time] [m/s].

        Its noise has twice the variance and is MA(1).
        """
        return self.velocity.diff(dim=1)


class AffineForces(Protocol):
    """Contact forces [..., 3, 3], rows N, T, M; affine: columns c [Pa], tan phi, 1."""

    def __call__(
        self, slip: Tensor, sinkage: Tensor, constants: Tensor, radius: float, width: float
    ) -> Tensor:
        """Return the forces [..., 3, 3] of wheels, as those of terramechanics.contact.stresses."""
        ...


def quadrature_forces(
    slip: Tensor, sinkage: Tensor, constants: Tensor, radius: float, width: float
) -> Tensor:
    """The stress integrals with 6 points a piece."""
    return wheel_forces(slip, sinkage, constants, radius, width, quadrature())


closed_form_forces: AffineForces = wheel_forces_linear_stress
"""The paper's f0 to f4."""


def velocity_features(
    slip: Tensor, sinkage: Tensor, constants: Tensor, vehicle: Vehicle, forces: AffineForces
) -> Tensor:
    """Return the change of velocity in one step, affine in (c [kPa], tan phi): [..., 3].

    Banerjee et al. eq. 17 on level ground: dv = step / m SUM_k p T_k. ``slip`` and ``sinkage`` are
    [..., axles], ``constants`` [6].
    """
    traction = forces(slip, sinkage, constants, vehicle.radius_m, vehicle.width_m)[..., 1, :].sum(
        -2
    )
    unit = torch.tensor([PA_PER_UNIT, 1.0, 1.0], dtype=torch.float64)
    return traction * unit * (vehicle.step_s * vehicle.wheels_per_axle / vehicle.mass_kg)
