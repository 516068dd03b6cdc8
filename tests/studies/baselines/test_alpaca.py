# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""ALPaCA against the exact matrix-normal posterior, and against P-ALPaCA where the two coincide."""

import pytest
import torch

from studies.baselines.alpaca import Alpaca, update_all
from studies.baselines.drives import closed_form_forces
from studies.baselines.features import LearntModel
from studies.baselines.palpaca import PaperPAlpaca
from studies.paper.plants import TESTING, PaperPlant, draw_drives, vehicle
from terramechanics.presets import load_rover, load_soil

GENERATOR = torch.Generator().manual_seed(12)
ROVER, SOIL = load_rover("paper_rover"), load_soil("loose_sand")


def randn(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=GENERATOR, dtype=torch.float64)


def test_the_recursion_equals_the_gaussian_over_the_stacked_matrix() -> None:
    """Condition vec(K), Gaussian of covariance Sigma x Lambda^-1, on all samples at once."""
    n_x, size, count = 2, 3, 9
    phi, x, mean = randn(1, count, size), randn(1, count, n_x), randn(n_x, size)
    root = randn(size, size)
    precision = root @ root.T + torch.eye(size, dtype=torch.float64)
    noise = torch.tensor([[0.5, 0.2], [0.2, 0.3]], dtype=torch.float64)
    posterior = update_all(phi, x, mean, precision)

    before = torch.kron(torch.linalg.inv(noise).contiguous(), precision)
    rows = torch.cat(
        [torch.kron(torch.eye(n_x, dtype=torch.float64), p.unsqueeze(0)) for p in phi[0]]
    )
    weight = torch.kron(torch.eye(count, dtype=torch.float64), torch.linalg.inv(noise).contiguous())
    after = before + rows.T @ weight @ rows
    stacked = torch.linalg.solve(after, before @ mean.flatten() + rows.T @ weight @ x[0].flatten())
    torch.testing.assert_close(posterior.mean[0, -1].flatten(), stacked)
    torch.testing.assert_close(
        torch.kron(noise, posterior.covariance[0, -1].contiguous()), torch.linalg.inv(after)
    )


def test_with_one_output_alpaca_is_p_alpaca_without_nominal_features() -> None:
    plant = PaperPlant.CLOSED_FORM
    drives = draw_drives(
        plant, ROVER, SOIL, TESTING, 6.0, 3, torch.Generator().manual_seed(1)
    ).drives
    torch.manual_seed(2)
    model = LearntModel(vehicle(ROVER, plant), SOIL.constants(), None, columns=4, hidden=8)
    model.scale_inputs(drives)
    one, other = Alpaca(model).estimate(drives), PaperPAlpaca(model, "").estimate(drives)
    assert one.velocity is not None
    assert one.velocity_sd is not None
    torch.testing.assert_close(one.velocity, other.velocity)
    torch.testing.assert_close(one.velocity_sd, other.velocity_sd)
    assert other.parameters is None


def test_nominal_features_come_before_the_learnt_ones() -> None:
    plant = PaperPlant.CLOSED_FORM
    drives = draw_drives(
        plant, ROVER, SOIL, TESTING, 2.0, 2, torch.Generator().manual_seed(1)
    ).drives
    model = LearntModel(
        vehicle(ROVER, plant), SOIL.constants(), closed_form_forces, columns=4, hidden=8
    )
    features, constant = model.features(drives)
    assert features.shape == (2, 20, 6)
    torch.testing.assert_close(features[..., :2], model.nominal_features(drives)[..., :2])
    assert float(constant.abs().max()) > 0.0
    assert float(model.noise().detach()) == pytest.approx(0.02)
