# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What is true of a simulated rover: a sample, and the samples of a whole drive."""

from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.vehicle.rover import Rover


@dataclass(frozen=True, slots=True)
class Sample:
    """What is true at time t_j; slip, forces, torque and acceleration hold over (t_{j-1}, t_j].

    Shapes [batch] and [batch, axles], in a Drive [batch, time] and [batch, time, axles].
    """

    time: Tensor  # [s] t_j
    position: Tensor  # [m] horizontal place of the body
    height: Tensor  # [m] of the body's origin on the ground line
    velocity: Tensor  # [m/s] along body x
    acceleration: Tensor  # [m/s^2] dv/dt: v_j - v_{j-1} = dt a_j
    pitch: Tensor  # [rad] nose-up
    bogie_angle: Tensor  # [rad] nose-up, relative to the body
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
        """What an accelerometer along body x reads: dv/dt + g sin ab [m/s^2]."""
        return self.acceleration + gravity * torch.sin(self.pitch)


@dataclass(frozen=True, slots=True)
class Drive:
    """A whole run: ``sample`` has a time axis after the batch axis."""

    rover: Rover
    sample: Sample
    start_velocity: Tensor  # [batch] [m/s] v_0, one step before the first sample
    seen: (
        Sample  # what the sensors are given: the true sample, unless an effect acts between the two
    )

    def measurable(self) -> Tensor:
        """[batch, time] bool: the rover moves, is not stuck, and every wheel is in the range of the model."""
        return ~self.sample.stuck & ~self.sample.standing & self.sample.valid.all(-1)
