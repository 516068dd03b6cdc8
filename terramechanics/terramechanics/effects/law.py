# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of a named effect: one law for the simulator, the exported model and the search.

A law is a module that ``torch.jit.script`` can compile as a part of a model. Its values [n or 1, V]
are the value of its size and the extra values that its class lists; all zero is the nominal model.
Every method of the base class leaves the nominal model as it is.
"""

from typing import ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.rover import Rover


class ExtraValue(NamedTuple):
    """An unknown of an effect besides its size: mean zero, physical within four deviations."""

    name: str
    unit: str
    sd: float


class AddedForce(NamedTuple):
    """A force and a torque on one wheel beside those of the stresses, [..., n, A]."""

    traction: Tensor  # [N] added to T
    torque: Tensor  # [N m] added to M
    lateral: Tensor | None = None  # [N] added to Y, at a slip angle


class AddedMass(NamedTuple):
    """Mass that the rover file does not have."""

    mass: Tensor  # [n or 1, 1] [kg]
    moment: Tensor  # [n or 1, 2] [kg m] about the rover's centre of mass, along and up


class Readings(NamedTuple):
    """Sensor values that an effect can change, of n instants of A axles."""

    slip: Tensor  # [n, A] [1]
    slip_sd: Tensor  # [n, A] [1] its standard deviation; zero for a true sample
    sinkage: Tensor  # [n, A] [m]
    torque: Tensor  # [n, A] [N m]
    pitch: Tensor  # [n, 1] [rad]
    acceleration: Tensor  # [n, 1] [m/s^2] specific force along the body
    wheel_rate: Tensor  # [n, A] [rad/s]
    time: Tensor | None = None  # [n] [s] of a simulated sample
    slip_rate: Tensor | None = None  # [n, A] [1/s] where the neighbours in time are there
    sinkage_rate: Tensor | None = None  # [n, A] [m/s] likewise


def with_slip(readings: Readings, slip: Tensor, slip_sd: Tensor) -> Readings:
    """Return ``readings`` with other slips (TorchScript has no ``_replace``)."""
    return Readings(
        slip, slip_sd, readings.sinkage, readings.torque, readings.pitch,
        readings.acceleration, readings.wheel_rate, readings.time, readings.slip_rate,
        readings.sinkage_rate,
    )  # fmt: skip


def with_sinkage(readings: Readings, sinkage: Tensor) -> Readings:
    """Return ``readings`` with other sinkages."""
    return Readings(
        readings.slip, readings.slip_sd, sinkage, readings.torque, readings.pitch,
        readings.acceleration, readings.wheel_rate, readings.time, readings.slip_rate,
        readings.sinkage_rate,
    )  # fmt: skip


def with_torque(readings: Readings, torque: Tensor) -> Readings:
    """Return ``readings`` with other torques."""
    return Readings(
        readings.slip, readings.slip_sd, readings.sinkage, torque, readings.pitch,
        readings.acceleration, readings.wheel_rate, readings.time, readings.slip_rate,
        readings.sinkage_rate,
    )  # fmt: skip


def with_attitude(readings: Readings, pitch: Tensor, acceleration: Tensor) -> Readings:
    """Return ``readings`` with another pitch and another acceleration."""
    return Readings(
        readings.slip, readings.slip_sd, readings.sinkage, readings.torque, pitch, acceleration,
        readings.wheel_rate, readings.time, readings.slip_rate, readings.sinkage_rate,
    )  # fmt: skip


class Law(nn.Module):
    """One named effect on one rover."""

    extra: ClassVar[tuple[ExtraValue, ...]] = ()
    keeps_ruts: ClassVar[bool] = False  # it needs the ruts of the wheels before
    order: Tensor

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        """``axle`` is for an effect of one axle, 0 is the front."""
        super().__init__()
        del axle
        self.radius, self.count = rover.wheel_radius, 1 + len(self.extra)
        # number of wheels that rolled over the same ground before
        self.register_buffer("order", torch.arange(rover.axles, dtype=torch.float64))

    @classmethod
    def size_of(cls, value: float) -> float:
        """Return the size that belongs to its value. Forces are smooth in the value."""
        return value

    @classmethod
    def value_of(cls, size: float) -> float:
        """Return the value that belongs to a size."""
        return size

    @classmethod
    def slope(cls, value: float) -> float:
        """Return the change of the size with its value."""
        del value
        return 1.0

    def size_moments(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Return mean and variance [2] of the size from those of its value."""
        return torch.stack([mean, variance])

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Change the inputs of the stress integrals at wheel rates ``rate`` [n, A] [rad/s]."""
        del values, rate
        return inputs

    def stresses(self, forces: Tensor, inputs: ContactInputs, values: Tensor) -> Tensor:
        """Put another contact law in the place of one; coefficients [..., n, A, 3, 3]."""
        del inputs, values
        return forces

    def under_load(self, forces: Tensor, inputs: ContactInputs, values: Tensor) -> Tensor:
        """Add forces that depend on the load to the coefficients [..., n, A, 3 or 4, 3].

        Rows are N, T, M and, at a slip angle, Y; columns what goes with c, with tan(phi) and with
        neither. A simulation has all in the last one. Every law's :meth:`stresses` come first.
        """
        del inputs, values
        return forces

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return the force on each wheel beside the stresses; None for none."""
        del inputs, values
        return None

    def added_mass(self, values: Tensor) -> AddedMass | None:
        """Return the mass that the body carries in addition; None for none."""
        del values
        return None

    def drive_loss(self, rate: Tensor, values: Tensor) -> Tensor:
        """Return the torque [n, A] [N m] lost between motor and wheel at ``rate`` [rad/s]."""
        del values
        return torch.zeros_like(rate)

    def reported(self, readings: Readings, values: Tensor) -> Readings:
        """Return what sensors report where ``readings`` are true."""
        del values
        return readings

    def corrected(self, readings: Readings, values: Tensor) -> Readings:
        """Return the true readings where these are reported; the inverse of :meth:`reported`."""
        del values
        return readings
