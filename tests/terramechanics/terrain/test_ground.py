# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil along the track."""

import math

import pytest
import torch

from terramechanics.presets import load_soil
from terramechanics.terrain.ground import Ground, Patch

LOOSE, COMPACT = load_soil("loose_sand"), load_soil("compact_sand")
WHEELS = torch.tensor([[5.4, 5.0, 4.6]], dtype=torch.float64)


def test_constant_ground_is_the_same_below_every_wheel() -> None:
    constants, strength = Ground.constant(LOOSE).at(WHEELS)
    assert constants.shape == (1, 3, 6)
    assert torch.equal(constants, LOOSE.constants().expand(1, 3, 6))
    assert torch.equal(strength, LOOSE.strength().expand(1, 3, 2))


def test_a_sharp_change_comes_below_one_wheel_after_the_other() -> None:
    ground = Ground([Patch.of(LOOSE), Patch.of(COMPACT, start=5.0)])
    constants, strength = ground.at(WHEELS)
    assert constants[0, :, 0].tolist() == [COMPACT.n, COMPACT.n, LOOSE.n]
    assert strength[0, :, 0].tolist() == [COMPACT.cohesion, COMPACT.cohesion, LOOSE.cohesion]
    assert [ground.patch_at(x) for x in (-1.0, 4.99, 5.0, 99.0)] == [0, 0, 1, 1]


def test_a_gradual_change_is_linear_along_the_track() -> None:
    _, strength = Ground([Patch.of(LOOSE), Patch.of(COMPACT, start=4.6, transition=1.6)]).at(WHEELS)
    shares = [0.5, 0.25, 0.0]
    assert strength[0, :, 0].tolist() == pytest.approx(
        [LOOSE.cohesion + share * (COMPACT.cohesion - LOOSE.cohesion) for share in shares]
    )


def test_random_strengths_are_uniform_in_their_ranges() -> None:
    """Draw 2000 times.

    Extremes come within 1 % of the ends with probability 1 - 4 (0.99)^2000, means within 4
    deviations.
    """
    ground = Ground.random_strength(LOOSE, 2000, torch.Generator().manual_seed(1))
    cohesion, tan_phi = ground.patches[0].strength.unbind(-1)
    angle = torch.atan(tan_phi).rad2deg()
    for drawn, low, high in ((cohesion, 500.0, 5000.0), (angle, 15.0, 45.0)):
        width = high - low
        assert low <= float(drawn.min()) < low + 0.01 * width
        assert high - 0.01 * width < float(drawn.max()) <= high
        assert float(drawn.mean()) == pytest.approx(
            (low + high) / 2.0, abs=4.0 * width / math.sqrt(12.0 * 2000.0)
        )
    assert ground.at(torch.zeros(2000, 3, dtype=torch.float64))[0].shape == (2000, 3, 6)


def test_patches_out_of_order_are_refused() -> None:
    with pytest.raises(
        ValueError, match="the patch at 5 m must start behind the transition of the patch at 4 m"
    ):
        Ground(
            [
                Patch.of(LOOSE),
                Patch.of(COMPACT, start=4.0, transition=2.0),
                Patch.of(LOOSE, start=5.0),
            ]
        )
    with pytest.raises(ValueError, match="at least one patch"):
        Ground([])
