# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's P-ALPaCA model: nominal and learnt features of the velocity row, prior and noise."""

from enum import Enum

import torch
from torch import Tensor, nn

from studies.baselines.drives import AffineForces, LevelDrives, Vehicle, velocity_features
from studies.baselines.interface import BaselinePrior

INPUTS = 7
"""Velocity, three slips, three sinkages."""


class FeatureSpan(Enum):
    """Part of the learnt features that the regression uses."""

    FREE = "as the net gives them"
    PROJECTED = "less their regression on the nominal features over the training drives"


class LearntModel(nn.Module):
    """Model of the velocity increment with nominal and learnt features.

    Phi = [Phi_nom Phi_net], k ~ N(mean, diag(precision)^-1), eps ~ N(0, noise^2).

    The net sees velocity, slips and sinkages, each scaled to order one; the torques that the
    paper's text lists too are not among the inputs of the authors' code, and would tell the
    traction without any ground. ``forces`` None leaves the nominal features out. Parameters in the
    units kPa, 1 and m/s.
    """

    input_mean: Tensor
    input_scale: Tensor
    shared: Tensor

    def __init__(
        self,
        vehicle: Vehicle,
        constants: Tensor,
        forces: AffineForces | None,
        columns: int = 32,
        hidden: int = 128,
        span: FeatureSpan = FeatureSpan.FREE,
    ) -> None:
        """Build an untrained model; call ``scale_inputs`` before its use.

        ``constants`` [6] are those assumed of the soil.
        """
        super().__init__()
        self.vehicle, self.constants, self.forces, self.span = vehicle, constants, forces, span
        self.columns = columns
        start = BaselinePrior()
        self.nominal = 2 if forces is not None else 0
        self.net = nn.Sequential(
            nn.Linear(INPUTS, hidden, dtype=torch.float64),
            nn.Tanh(),
            nn.Linear(hidden, hidden, dtype=torch.float64),
            nn.Tanh(),
            nn.Linear(hidden, columns, dtype=torch.float64),
        )
        mean = torch.cat([start.mean()[: self.nominal], torch.zeros(columns, dtype=torch.float64)])
        net_precision = torch.full(
            (columns,), 0.05**-2.0, dtype=torch.float64
        )  # 0.05 m/s a step and feature
        self.mean = nn.Parameter(mean)
        self.log_precision = nn.Parameter(
            torch.cat([start.precision()[: self.nominal], net_precision]).log()
        )
        self.log_noise = nn.Parameter(torch.tensor(0.02, dtype=torch.float64).log())
        self.register_buffer("input_mean", torch.zeros(INPUTS, dtype=torch.float64))
        self.register_buffer("input_scale", torch.ones(INPUTS, dtype=torch.float64))
        self.register_buffer("shared", torch.zeros(self.nominal, columns, dtype=torch.float64))

    def scale_inputs(self, drives: LevelDrives) -> None:
        """Mean and spread of the inputs over these drives."""
        inputs = net_inputs(drives).flatten(0, 1)
        self.input_mean.copy_(inputs.mean(0))
        self.input_scale.copy_(inputs.std(0).clamp(min=1e-9))

    def noise(self) -> Tensor:
        """Learnt standard deviation of the row [m/s], a scalar."""
        return self.log_noise.exp()

    def prior(self) -> tuple[Tensor, Tensor]:
        """Mean and diagonal precision [2 + columns] of the parameters."""
        return self.mean, self.log_precision.exp()

    def nominal_features(self, drives: LevelDrives) -> Tensor:
        """Return columns c [kPa], tan phi, 1 [batch, time, 3].

        Without nominal features the columns are empty, and the last is 0.
        """
        if self.forces is None:
            return torch.zeros(*drives.slip.shape[:2], 1, dtype=torch.float64)
        return velocity_features(
            drives.slip, drives.sinkage, self.constants, self.vehicle, self.forces
        )

    def features(self, drives: LevelDrives) -> tuple[Tensor, Tensor]:
        """Phi [batch, time, 2 + columns] and the constant phi_nom [batch, time] of every row."""
        nominal = self.nominal_features(drives)
        return self.joined(nominal[..., :-1], net_inputs(drives)), nominal[..., -1]

    def joined(self, nominal: Tensor, inputs: Tensor) -> Tensor:
        """Phi [..., 2 + columns] of nominal features [..., 2] and inputs [..., INPUTS]."""
        learnt = self.net((inputs - self.input_mean) / self.input_scale)
        if self.span is FeatureSpan.PROJECTED:
            learnt = learnt - nominal @ self.shared
        return torch.cat([nominal, learnt], -1)


def net_inputs(drives: LevelDrives) -> Tensor:
    """Return velocity before the step, slips and sinkages [batch, time, INPUTS] of three axles."""
    return torch.cat([drives.velocity[:, :-1].unsqueeze(-1), drives.slip, drives.sinkage], -1)
