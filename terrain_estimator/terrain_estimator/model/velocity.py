# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The velocity between the blocks: a scalar Kalman filter, driven by the force that the posterior predicts."""

import torch
from torch import Tensor, nn

from terrain_estimator.model.gaussian import drop
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.physics import Physics
from terrain_estimator.model.prior import Prior, RoverBody
from terrain_estimator.model.rows import drive_row

OPEN = 1e-2
"""[(m/s)^-2] Precision of a velocity that nothing is known of."""
MEMORY = 0.05
"""[1] Share of the newest change of the acceleration in their mean square."""


class VelocityFilter(Physics):
    """Follows, foretells and re-opens the velocity of a state."""

    def __init__(
        self, body: RoverBody, constants: Tensor, prior: Prior, net: NetFeatures, added: int = 0
    ) -> None:
        """See Physics."""
        super().__init__(body, constants, prior, net, added)
        self.open_precision = OPEN
        self.memory = MEMORY

    @torch.jit.export
    def predict(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """Posterior predictive of the velocity that ``observation`` measures: mean [m/s] and variance, shape [2]."""
        mean, variance, _, _ = self.foresee(state, observation)
        return torch.stack([mean, variance + observation[8 * self.axles + 1] ** 2])

    @torch.jit.export
    def forecast(self, state: dict[str, Tensor], horizon_s: float) -> Tensor:
        """The true velocity ``horizon_s`` after the last observation if slip persists: mean [m/s] and variance, shape [2].

        NaN until an acceleration is known, after a gap as well, and a change of it. The noise of
        the last slip and sinkage moves the velocity and the acceleration alike, so both errors are
        correlated; what the acceleration changes by from one sample to the next holds that noise
        twice, and only what is beyond is change of the ground.
        """
        acceleration, noise, change, seen, spread, shared = state["drive"].unbind(0)
        velocity, variance = state["velocity"].unbind(0)
        wander = torch.clamp(change / seen - 2.0 * noise, min=0.0)
        uncertain = variance + 2.0 * horizon_s * shared + horizon_s**2 * (spread + wander)
        ahead = torch.stack([velocity + horizon_s * acceleration, uncertain])
        return torch.where(
            torch.isnan(acceleration) | (seen == 0.0), torch.full_like(ahead, float("nan")), ahead
        )

    def drive(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """The velocity row at ``observation`` and its changes by what is uncertain, as :func:`drive_row` has them."""
        return drive_row(observation[: 8 * self.axles].view(8, self.axles), self.leading(state))

    def foresee(
        self, state: dict[str, Tensor], observation: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """True velocity at ``observation``, from the velocity before and its force: mean, variance, acceleration and its variance."""
        a, expected = self.axles, state["expected"]
        by_cohesion, by_friction, alone = self.drive(state, observation).unbind(1)
        cohesion, friction = expected[:2].unbind(0)
        row = torch.addcmul(
            torch.addcmul(alone, by_cohesion, cohesion), by_friction, friction
        )  # and its change by what is uncertain
        slip, _, sinkage, _, angle, rest = observation.split_with_sizes(
            [a, a, a, a, a, observation.shape[0] - 5 * a]
        )
        pitch = rest[3 * a + 2 : 3 * a + 3]
        learnt = self.net.distinct(slip, sinkage, angle, pitch)[0]
        direction = torch.cat([by_cohesion[:1], by_friction[:1], learnt, row[1:]])
        known = direction.shape[0]
        explained = row[0] + (learnt * expected[2 : self.first_constant]).sum()
        acceleration = explained - self.gravity * torch.sin(pitch[0])
        step = observation[-2]
        spread = (
            torch.dot(direction, torch.mv(state["covariance"][:known, :known], direction))
            + state["drive"][1]
        )
        velocity, variance = state["velocity"].unbind(0)
        return (
            torch.addcmul(velocity, step, acceleration),
            torch.addcmul(variance, step * step, spread),
            acceleration,
            spread,
        )

    def track(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """Kalman step of the velocity."""
        mean, variance, acceleration, spread = self.foresee(state, observation)
        measured, deviation = observation[8 * self.axles : 8 * self.axles + 2].unbind(0)
        before, noise, change, seen, _, _ = state["drive"].unbind(0)
        own, innovation = deviation * deviation, measured - mean
        total = variance + own
        gain = variance / total
        state = state.copy()
        state["velocity"] = torch.stack([torch.addcmul(mean, gain, innovation), gain * own])
        first = torch.isnan(before)
        change = torch.where(
            first, change, torch.lerp(change, (acceleration - before).square(), self.memory)
        )
        seen = torch.where(first, seen, torch.lerp(seen, torch.ones_like(seen), self.memory))
        shared = (1.0 - gain) * observation[-2] * spread
        state["drive"] = torch.stack([acceleration, noise, change, seen, spread, shared])
        state["innovation"] = torch.stack([innovation, total])
        return state

    def steer(self, state: dict[str, Tensor], noise: Tensor) -> dict[str, Tensor]:
        """Let the velocity go on from the posterior; ``noise`` [n, E, 3] is that of the block's velocity rows."""
        expected = state["expected"]
        by_source = noise @ torch.cat([expected[:2], torch.ones_like(expected[:1])])
        state["velocity"] = torch.stack([expected[-1], state["covariance"][-1, -1]])
        state["drive"] = torch.cat(
            [state["drive"][:1], by_source.square().sum(1).mean().unsqueeze(0), state["drive"][2:]]
        )
        return state

    def unlink(
        self, state: dict[str, Tensor], velocity: Tensor, variance: Tensor
    ) -> dict[str, Tensor]:
        """Open the velocity again: what was known of it says nothing about the one that ``velocity`` measures."""
        mean, precision = drop(state["mean"], state["precision"], self.size - 1)
        opened = nn.functional.pad(precision, [0, 1, 0, 1])
        opened[:, -1, -1] = self.open_precision
        state = state.copy()
        state["mean"] = torch.cat([mean, velocity.expand(mean.shape[0], 1)], 1)
        state["precision"] = opened
        # What is born takes its velocity from here.
        state["expected"] = torch.cat([state["expected"][:-1], velocity.unsqueeze(0)])
        state["covariance"] = nn.functional.pad(state["covariance"][:-1, :-1], [0, 1, 0, 1])
        state["covariance"][-1, -1] = 1.0 / self.open_precision
        state["velocity"] = torch.stack([velocity, variance])
        state["drive"] = torch.cat(
            [torch.full_like(velocity, float("nan")).unsqueeze(0), state["drive"][1:]]
        )
        state["innovation"] = torch.full_like(state["innovation"], float("nan"))
        return state
