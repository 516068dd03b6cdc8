# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The velocity between the blocks: a scalar Kalman filter, driven by the force that the posterior predicts."""

import torch
from torch import Tensor, nn

from terrain_estimator.gaussian import drop
from terrain_estimator.net import NetFeatures
from terrain_estimator.physics import Physics
from terrain_estimator.prior import Body, Prior
from terrain_estimator.rows import drive_row

OPEN = 1e-2
"""[(m/s)^-2] Precision of a velocity that nothing is known of."""


class VelocityFilter(Physics):
    """Follows, foretells and re-opens the velocity of a state."""

    def __init__(self, body: Body, constants: Tensor, prior: Prior, net: NetFeatures, added: int = 0) -> None:
        """See Physics."""
        super().__init__(body, constants, prior, net, added)
        self.open_precision = OPEN

    @torch.jit.export
    def predict(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """Posterior predictive of the velocity that ``observation`` measures: mean [m/s] and variance, shape [2]."""
        predicted = self.foresee(state, observation)
        return torch.stack([predicted[0], predicted[1] + observation[8 * self.axles + 1] ** 2])

    @torch.jit.export
    def forecast(self, state: dict[str, Tensor], horizon_s: float) -> Tensor:
        """The true velocity ``horizon_s`` after the last observation if slip persists: mean [m/s] and variance, shape [2]."""
        velocity, drive = state["velocity"], state["drive"]
        return torch.stack([velocity[0] + horizon_s * drive[0], velocity[1] + horizon_s**2 * (drive[1] + drive[2])])

    def drive(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """The velocity row at ``observation`` and its changes by what is uncertain, as :func:`drive_row` has them."""
        return drive_row(observation[: 8 * self.axles].view(8, self.axles), self.leading(state))

    def foresee(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """True velocity at ``observation``, from the velocity before and its force: mean, variance, acceleration [3]."""
        a, expected = self.axles, state["expected"]
        rows = self.drive(state, observation)
        by_constant = rows[1:] @ torch.cat([expected[:2], torch.ones_like(expected[:1])])
        direction = torch.cat([rows[0, :2], self.learnt(observation.unsqueeze(0))[0, 0], by_constant])
        known = direction.shape[0]
        explained = torch.dot(direction[: self.first_constant], expected[: self.first_constant]) + rows[0, 2]
        acceleration = explained - self.gravity * torch.sin(observation[8 * a + 2])
        step = observation[-2]
        spread = torch.dot(direction, torch.mv(state["covariance"][:known, :known], direction)) + state["drive"][1]
        velocity = state["velocity"]
        return torch.stack([velocity[0] + step * acceleration, velocity[1] + step**2 * spread, acceleration])

    def track(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """Kalman step of the velocity."""
        mean, variance, acceleration = self.foresee(state, observation).unbind(0)
        noise = observation[8 * self.axles + 1] ** 2
        innovation, total = observation[8 * self.axles] - mean, variance + noise
        drive = state["drive"]
        change = 0.95 * drive[2] + 0.05 * (acceleration - drive[0]) ** 2
        state = state.copy()
        state["velocity"] = torch.stack([mean + variance / total * innovation, variance / total * noise])
        state["drive"] = torch.stack([acceleration, drive[1], change])
        state["innovation"] = torch.stack([innovation, total])
        return state

    def steer(self, state: dict[str, Tensor], noise: Tensor) -> dict[str, Tensor]:
        """Let the velocity go on from the posterior; ``noise`` [n, E, 3] is that of the block's velocity rows."""
        expected = state["expected"]
        by_source = noise @ torch.cat([expected[:2], torch.ones_like(expected[:1])])
        state["velocity"] = torch.stack([expected[-1], state["covariance"][-1, -1]])
        state["drive"] = torch.stack([state["drive"][0], by_source.square().sum(1).mean(), state["drive"][2]])
        return state

    def unlink(self, state: dict[str, Tensor], velocity: Tensor, variance: Tensor) -> dict[str, Tensor]:
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
        state["innovation"] = torch.full_like(state["innovation"], float("nan"))
        return state
