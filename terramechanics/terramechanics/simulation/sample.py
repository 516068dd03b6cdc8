# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Values of a simulated rover: a true sample, those of a whole drive, and a measured one."""

from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.vehicle.rover import Rover

TIME_STEP = 0.1
"""[s] Step of the simulation, the period of the samples, unless another is asked for."""
SLOWEST = 1e-3
"""[m/s] Circumferential speed below which a wheel stands."""


@dataclass(frozen=True, slots=True)
class Sample:
    """True values at t_j; slip, forces, torque and acceleration hold over (t_{j-1}, t_j].

    Shapes [batch] and [batch, axles], in a Drive [batch, time] and [batch, time, axles].
    """

    time: Tensor  # [s] t_j
    position: Tensor  # [m] horizontal place of the body
    height: Tensor  # [m] of the body's origin on the ground line
    velocity: Tensor  # [m/s] along body x
    acceleration: Tensor  # [m/s^2] dv/dt: v_j - v_{j-1} = dt a_j
    pitch: Tensor  # [rad] nose-up
    bogie_angle: Tensor  # [rad] nose-up, relative to the body; 0 of a rover without a joint
    stuck: Tensor  # bool, from the first stuck second on
    standing: Tensor  # bool: the wheels stand, slip is not defined
    slip: Tensor  # [1] NaN where the wheels stand
    sinkage: Tensor  # [m]
    contact: Tensor  # [m] horizontal place at which the wheel touches the ground
    contact_angle: Tensor  # [rad] ground relative to the body
    wheel_rate: Tensor  # [rad/s]
    torque: Tensor  # [N m] drive torque of one wheel: ground_torque + wheel_inertia dw/dt
    normal: Tensor  # [N] N of one wheel
    traction: Tensor  # [N] T of one wheel
    ground_torque: Tensor  # [N m] M of one wheel
    valid: Tensor  # bool: the wheel is in the range of the contact model
    constants: Tensor  # [..., axles, 6] soil constants below the wheel
    strength: Tensor  # [..., axles, 2] c [Pa] and tan(phi) below the wheel

    def specific_force(self, gravity: float) -> Tensor:
        """Return the specific force along body x: dv/dt + g sin ab [m/s^2]."""
        return self.acceleration + gravity * torch.sin(self.pitch)


@dataclass(frozen=True, slots=True)
class Drive:
    """A whole run: ``sample`` has a time axis after the batch axis."""

    rover: Rover
    sample: Sample
    start_velocity: Tensor  # [batch] [m/s] v_0, one step before the first sample
    seen: Sample  # the input of the sensors: the true sample, unless an effect alters it

    def measurable(self) -> Tensor:
        """Return where the rover moves and the model holds for every wheel, [batch, time]."""
        return ~self.sample.stuck & ~self.sample.standing & self.sample.valid.all(-1)


@dataclass(frozen=True, slots=True)
class Measurement:
    """Measured values and standard deviations (``_sd``); shapes as in the Sample.

    Wheel rates are exact, as is the bogie's angle.
    """

    slip: Tensor
    slip_sd: Tensor
    sinkage: Tensor
    sinkage_sd: Tensor
    contact_angle: Tensor
    contact_angle_sd: Tensor
    wheel_rate: Tensor
    torque: Tensor
    torque_sd: Tensor
    velocity: Tensor
    velocity_sd: Tensor
    pitch: Tensor
    pitch_sd: Tensor
    acceleration: Tensor  # specific force dv/dt + g sin ab
    acceleration_sd: Tensor  # noise and bias together
    bogie_angle: Tensor  # [rad] an encoder's, exact
