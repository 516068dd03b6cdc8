# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The velocity between blocks: a scalar Kalman filter that the predicted force drives."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.model.gaussian import drop

OPEN = 1e-2
"""[(m/s)^-2] Precision of an unknown velocity."""
MEMORY = 0.05
"""[1] Share of the newest change of the acceleration in their mean square."""


class Motion(NamedTuple):
    """Predicted velocity and acceleration at an observation, each []."""

    velocity: Tensor  # [m/s]
    velocity_variance: Tensor
    acceleration: Tensor  # [m/s^2]
    acceleration_variance: Tensor


class VelocityFilter(nn.Module):
    """Predicts, tracks and re-opens the velocity of a state."""

    def __init__(self, gravity: float, first_constant: int) -> None:
        """Take the gravity [m/s^2] and the number of parameters before the soil constants."""
        super().__init__()
        self.gravity, self.first_constant = gravity, first_constant
        self.open_precision, self.memory = OPEN, MEMORY

    def predict(
        self, state: dict[str, Tensor], row: Tensor, learnt: Tensor, pitch: Tensor, step: Tensor
    ) -> Motion:
        """Return the true velocity after ``step`` [s] and the acceleration, as the posterior predicts them.

        ``row`` [1 + M + V, 3] is the velocity row and its changes by the uncertain values, as
        :func:`~terrain_estimator.model.rows.drive_row` returns it; ``learnt`` [net] its net columns.
        """
        expected = state["expected"]
        by_cohesion, by_friction, alone = row.unbind(1)
        cohesion, friction = expected[:2].unbind(0)
        total = torch.addcmul(torch.addcmul(alone, by_cohesion, cohesion), by_friction, friction)
        direction = torch.cat([by_cohesion[:1], by_friction[:1], learnt, total[1:]])
        known = direction.shape[0]
        explained = total[0] + (learnt * expected[2 : self.first_constant]).sum()
        acceleration = explained - self.gravity * torch.sin(pitch)
        variance = (
            torch.dot(direction, torch.mv(state["covariance"][:known, :known], direction))
            + state["feature_noise"]
        )
        return Motion(
            torch.addcmul(state["velocity"], step, acceleration),
            torch.addcmul(state["velocity_variance"], step * step, variance),
            acceleration,
            variance,
        )

    def forecast(self, state: dict[str, Tensor], horizon_s: float) -> tuple[Tensor, Tensor]:
        """Return mean [m/s] and variance of the true velocity ``horizon_s`` ahead if slip persists.

        Both are NaN until an acceleration and a change of it are known, after a gap as well. The
        noise of the last slip and sinkage moves velocity and acceleration alike, so both errors are
        correlated. The change of the acceleration from one sample to the next holds that noise
        twice; only the rest is change of the ground.
        """
        acceleration, seen = state["acceleration"], state["change_weight"]
        walk = torch.clamp(state["change"] / seen - 2.0 * state["feature_noise"], min=0.0)
        mean = state["velocity"] + horizon_s * acceleration
        variance = (
            state["velocity_variance"]
            + 2.0 * horizon_s * state["velocity_acceleration_covariance"]
            + horizon_s**2 * (state["acceleration_variance"] + walk)
        )
        unknown = torch.isnan(acceleration) | (seen == 0.0)
        nothing = torch.full_like(mean, float("nan"))
        return torch.where(unknown, nothing, mean), torch.where(unknown, nothing, variance)

    def track(
        self, state: dict[str, Tensor], motion: Motion, measured: Tensor, sd: Tensor, step: Tensor
    ) -> dict[str, Tensor]:
        """Return the state after a Kalman step with the velocity ``measured`` [] [m/s]."""
        own, innovation = sd * sd, measured - motion.velocity
        total = motion.velocity_variance + own
        gain = motion.velocity_variance / total
        before, change, seen = state["acceleration"], state["change"], state["change_weight"]
        first = torch.isnan(before)
        moved = (motion.acceleration - before).square()
        state = state.copy()
        state["velocity"] = torch.addcmul(motion.velocity, gain, innovation)
        state["velocity_variance"] = gain * own
        state["change"] = torch.where(first, change, torch.lerp(change, moved, self.memory))
        state["change_weight"] = torch.where(
            first, seen, torch.lerp(seen, torch.ones_like(seen), self.memory)
        )
        state["acceleration"] = motion.acceleration
        state["acceleration_variance"] = motion.acceleration_variance
        state["velocity_acceleration_covariance"] = (
            (1.0 - gain) * step * motion.acceleration_variance
        )
        state["innovation"], state["innovation_variance"] = innovation, total
        return state

    def reinitialize(self, state: dict[str, Tensor], noise: Tensor) -> dict[str, Tensor]:
        """Return the state with the velocity of the posterior.

        ``noise`` [n, E, 3] is that of the block's velocity rows.
        """
        expected = state["expected"]
        by_source = noise @ torch.cat([expected[:2], torch.ones_like(expected[:1])])
        state = state.copy()
        state["velocity"], state["velocity_variance"] = expected[-1], state["covariance"][-1, -1]
        state["feature_noise"] = by_source.square().sum(1).mean()
        return state

    def unlink(
        self, state: dict[str, Tensor], velocity: Tensor, variance: Tensor
    ) -> dict[str, Tensor]:
        """Return the state with an unknown velocity in the posterior, and ``velocity`` [] in the filter."""
        index = state["mean"].shape[1] - 1
        mean, precision = drop(state["mean"], state["precision"], index)
        opened = nn.functional.pad(precision, [0, 1, 0, 1])
        opened[:, -1, -1] = self.open_precision
        state = state.copy()
        state["mean"] = torch.cat([mean, velocity.expand(mean.shape[0], 1)], 1)
        state["precision"] = opened
        # Hypotheses that are started anew take their velocity from here.
        state["expected"] = torch.cat([state["expected"][:-1], velocity.unsqueeze(0)])
        state["covariance"] = nn.functional.pad(state["covariance"][:-1, :-1], [0, 1, 0, 1])
        state["covariance"][-1, -1] = 1.0 / self.open_precision
        state["velocity"], state["velocity_variance"] = velocity, variance
        nothing = torch.full_like(velocity, float("nan"))
        state["acceleration"] = nothing
        state["innovation"], state["innovation_variance"] = nothing, nothing
        return state
