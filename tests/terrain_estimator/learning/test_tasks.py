# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Distributions of the truth of simulated drives."""

import numpy as np
import torch
from scipy.stats import truncnorm

from studies.accuracy.scores import FROM_PRIOR
from terrain_estimator.learning.tasks import StrengthRange, degrees


def test_the_prior_above_zero_has_the_quantiles_of_the_truncated_gaussians() -> None:
    share = torch.tensor([0.0, 0.001, 0.3, 0.5, 0.999], dtype=torch.float64)
    drawn = FROM_PRIOR.strength(torch.stack([share, share.flip(0)], 1)).numpy()
    for column, shares, mean, sd in zip(
        drawn.T, (share, share.flip(0)), FROM_PRIOR.mean, FROM_PRIOR.sd, strict=True
    ):
        expected = truncnorm.ppf(shares.numpy(), -mean / sd, np.inf, loc=mean, scale=sd)
        np.testing.assert_allclose(column, expected, rtol=1e-9, atol=1e-9 * sd)


def test_a_range_is_uniform_in_cohesion_and_angle_over_all_its_intervals() -> None:
    ground = StrengthRange(((500.0, 600.0), (1000.0, 1300.0)), (degrees(10.0, 20.0),))
    share = torch.tensor([[0.0, 0.0], [0.25, 0.5], [0.5, 1.0]], dtype=torch.float64)
    expected = [
        [500.0, np.tan(np.radians(10.0))],
        [1000.0, np.tan(np.radians(15.0))],
        [1100.0, np.tan(np.radians(20.0))],
    ]
    np.testing.assert_allclose(ground.strength(share).numpy(), expected, rtol=1e-12)
