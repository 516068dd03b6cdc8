# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Uneven ground in two directions: its gradient, how steep it is, and the level plane."""

import math

import torch

from terramechanics.terrain.surface import Level, random_waves

STEEPEST = math.radians(5.0)


def places(*shape: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(2)
    return 20.0 * torch.rand(*shape, 2, generator=generator, dtype=torch.float64)


def test_the_gradient_is_that_of_the_height() -> None:
    ground, at, small = (
        random_waves(3, STEEPEST, torch.Generator().manual_seed(1)),
        places(3, 7),
        1e-5,
    )
    _, gradient = ground.shape(at)
    for axis in range(2):
        step = torch.zeros(2, dtype=torch.float64)
        step[axis] = small
        rise = (ground.shape(at + step)[0] - ground.shape(at - step)[0]) / (2.0 * small)
        torch.testing.assert_close(gradient[..., axis], rise, rtol=0.0, atol=1e-9)


def test_random_ground_leans_every_way_and_at_most_about_as_asked() -> None:
    ground = random_waves(20, STEEPEST, torch.Generator().manual_seed(1))
    _, gradient = ground.shape(places(20, 500) - 10.0)
    steep = gradient.norm(dim=-1).amax(1)
    assert float(steep.max()) < 1.1 * math.tan(STEEPEST)
    assert float(steep.max()) > 0.85 * math.tan(STEEPEST)
    assert float(steep.min()) > 0.3 * math.tan(STEEPEST)
    along, across = gradient.square().mean((0, 1)).tolist()
    assert 0.7 < along / across < 1.4


def test_the_plane_has_no_height() -> None:
    height, gradient = Level().shape(places(2, 4))
    assert height.shape == (2, 4)
    assert gradient.shape == (2, 4, 2)
    assert not height.any()
    assert not gradient.any()
