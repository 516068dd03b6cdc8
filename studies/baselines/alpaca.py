# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""ALPaCA (Harrison, Sharma and Pavone 2018): matrix-normal posterior of a network's last layer.

    K ~ MN(Kbar, Lambda^-1, Sigma_eps)        x = K phi + eps
    s = Lambda_(t-1)^-1 phi
    Lambda_t^-1 = Lambda_(t-1)^-1 - s s' / (1 + phi' s)
    Q_t = x_t phi_t' + Q_(t-1), Q_0 = Kbar_0 Lambda_0        Kbar_t = Q_t Lambda_t^-1
    x_(t+1) ~ N(Kbar_t phi, (1 + phi' Lambda_t^-1 phi) Sigma_eps)

With K of shape [n_x, n_phi] the precision stands on the right; the paper writes Kbar = Lambda^-1 Q.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from studies.baselines.drives import LevelDrives
from studies.baselines.features import LearntModel
from studies.baselines.interface import Estimates
from terrain_estimator.model.gaussian import cholesky, symmetrize


@dataclass(frozen=True, slots=True)
class MatrixNormal:
    """Posterior of K after 0, 1, ... T samples."""

    mean: Tensor  # [batch, T + 1, n_x, n_phi]
    covariance: Tensor  # [batch, T + 1, n_phi, n_phi] Lambda^-1


def update_all(phi: Tensor, x: Tensor, mean: Tensor, precision: Tensor) -> MatrixNormal:
    """Return the posteriors after every sample.

    ``phi`` [batch, T, n_phi], ``x`` [batch, T, n_x]; prior ``mean`` [n_x, n_phi], ``precision``
    [n_phi, n_phi].
    """
    batch, _, size = phi.shape
    inverse = torch.cholesky_solve(
        torch.eye(size, dtype=torch.float64), cholesky(precision)
    ).expand(batch, size, size)
    Q = (mean @ precision).expand(batch, *mean.shape)
    means, covariances = [Q @ inverse], [inverse]
    for feature, value in zip(phi.unbind(1), x.unbind(1), strict=True):
        spread = torch.einsum("bij,bj->bi", inverse, feature)
        shrink = 1.0 + (feature * spread).sum(-1)
        inverse = symmetrize(
            inverse - spread.unsqueeze(-1) * spread.unsqueeze(-2) / shrink.view(-1, 1, 1)
        )
        Q = Q + value.unsqueeze(-1) * feature.unsqueeze(-2)
        means.append(Q @ inverse)
        covariances.append(inverse)
    return MatrixNormal(torch.stack(means, 1), torch.stack(covariances, 1))


@dataclass(frozen=True, slots=True)
class Alpaca:
    """Velocity increments from learnt features alone: no estimate of c and tan phi."""

    model: LearntModel
    name: str = "ALPaCA"

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Predict the velocity of all drives.

        Sigma_eps scales the prior of K here, so the learnt precision is in its units.
        """
        with torch.no_grad():
            phi, _ = self.model.features(drives)
            noise = self.model.noise()
            mean, precision = self.model.prior()
            posterior = update_all(
                phi,
                drives.increment.unsqueeze(-1),
                mean.unsqueeze(0),
                torch.diag(precision) * noise**2,
            )
        change = torch.einsum("btxd,btd->btx", posterior.mean[:, :-1], phi)[..., 0]
        epistemic = torch.einsum("btd,btde,bte->bt", phi, posterior.covariance[:, :-1], phi)
        return Estimates(
            velocity=drives.velocity[:, :-1] + change, velocity_sd=noise * (1.0 + epistemic).sqrt()
        )
