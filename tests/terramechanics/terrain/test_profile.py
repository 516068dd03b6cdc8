# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Terrain profiles: their derivatives, and the bounds of random hills."""

import math

import pytest
import torch

from terramechanics.terrain.profile import (
    MEAN_SLOPE,
    STEEPEST,
    WAVELENGTHS,
    Flat,
    Hills,
    Profile,
    Ramp,
    Sampled,
    StepProfile,
    random_hills,
)

BATCH = 500


def hills(capability: float = 1.0, seed: int = 1) -> Hills:
    return random_hills(
        BATCH,
        torch.full((BATCH,), capability, dtype=torch.float64),
        torch.Generator().manual_seed(seed),
    )


def sampled(spacing: float = 0.5) -> Sampled:
    """Return slopes of hills by samples that cover less than the queries."""
    places = spacing * torch.arange(round(4.0 / spacing) + 1, dtype=torch.float64).expand(BATCH, -1)
    _, slope, curvature = hills().shape(places)
    curvature[:, [0, -1]] = 0.0
    return Sampled(slope, curvature, 0.0, spacing)


@pytest.mark.parametrize(
    "profile",
    [
        sampled(),
        Flat(),
        Ramp(0.1),
        Ramp(-0.2, start=0.5, blend=0.3),
        StepProfile(0.1),
        StepProfile(-0.05, length=0.4),
        hills(),
    ],
)
def test_slope_and_curvature_are_the_derivatives_of_height(profile: Profile) -> None:
    x = (
        torch.linspace(-1.0, 6.0, 83, dtype=torch.float64)
        .expand(BATCH, -1)
        .clone()
        .requires_grad_()
    )
    height, slope, curvature = profile.shape(x)
    if isinstance(profile, Flat):
        assert not height.any()
        assert not slope.any()
        assert not curvature.any()
        return
    (by_height,) = torch.autograd.grad(height.sum(), x, retain_graph=True)
    (by_slope,) = torch.autograd.grad(slope.sum(), x)
    torch.testing.assert_close(by_height, slope.detach(), atol=1e-12, rtol=1e-10)
    torch.testing.assert_close(by_slope, curvature.detach(), atol=1e-11, rtol=1e-10)


def test_dense_samples_of_hills_are_the_hills() -> None:
    x = torch.linspace(0.1, 3.9, 40, dtype=torch.float64).expand(BATCH, -1)
    height, slope, _ = hills().shape(x)
    near = sampled(0.05).shape(x)
    torch.testing.assert_close(near[1], slope, atol=1e-6, rtol=0.0)
    start = hills().shape(torch.zeros(BATCH, 1, dtype=torch.float64))[0]
    torch.testing.assert_close(near[0], height - start, atol=1e-4, rtol=0.0)


def test_before_the_first_and_behind_the_last_sample_the_slope_stays() -> None:
    profile, ends = sampled(), torch.tensor([0.0, 4.0], dtype=torch.float64).expand(BATCH, -1)
    outside = torch.tensor([[-0.2, 4.1]], dtype=torch.float64).expand(BATCH, -1)
    height, slope, _ = profile.shape(ends)
    far, same, curvature = profile.shape(outside)
    torch.testing.assert_close(same, slope)
    torch.testing.assert_close(far, height + slope * (outside - ends))
    assert not curvature.any()


def test_a_ramp_ends_at_its_grade_and_a_step_at_its_rise() -> None:
    far = torch.tensor([[50.0]], dtype=torch.float64)
    assert float(Ramp(0.1).shape(far)[1]) == pytest.approx(math.tan(0.1))
    assert float(StepProfile(0.1).shape(far)[0]) == pytest.approx(0.1)
    assert float(StepProfile(0.1).shape(far)[1]) == 0.0


def test_random_hills_keep_their_bounds() -> None:
    drawn = hills()
    _, slope, _ = drawn.shape(
        torch.linspace(0.0, 100.0, 2001, dtype=torch.float64).expand(BATCH, -1)
    )
    steepest = slope.abs().amax(-1)
    assert float(steepest.max()) <= math.tan(STEEPEST)
    assert float(steepest.median()) > math.tan(STEEPEST) / 3.0
    assert float(drawn.mean.abs().max()) <= math.tan(MEAN_SLOPE) * 1.01
    assert float(drawn.mean.min()) < 0.0 < float(drawn.mean.max())
    length = 2.0 * math.pi / drawn.wavenumber
    assert WAVELENGTHS[0] <= float(length.min()) < float(length.max()) <= WAVELENGTHS[1]


def test_hills_are_no_steeper_than_half_of_what_the_rover_can_pull() -> None:
    _, slope, _ = hills(capability=0.06).shape(
        torch.linspace(0.0, 100.0, 2001, dtype=torch.float64).expand(BATCH, -1)
    )
    assert 0.01 < float(slope.abs().max()) <= 0.03
    assert not hills(capability=-0.1).shape(torch.ones(BATCH, 1, dtype=torch.float64))[1].any()


def test_the_same_seed_draws_the_same_hills() -> None:
    assert torch.equal(hills(seed=3).phase, hills(seed=3).phase)
    assert not torch.equal(hills(seed=3).phase, hills(seed=4).phase)
