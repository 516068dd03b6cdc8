# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Residuals of blocks: white where physics and noise are right, the same streamed and batched."""

import torch
from torch import Tensor

from studies.batched import ClosedBlocks, run
from studies.foreign.residuals import (
    BlockResiduals,
    block_residuals,
    kinds,
    residuals_of,
    whitened,
)
from studies.foreign.watch import Closed
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.learning.tasks import draw_tasks
from terramechanics.presets import load_rover, load_soil

DRIVES, BLOCKS = 6, 20
ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
MODEL = physics_alone(ROVER, SOIL, exact=False)


def batched(measured: Tensor) -> dict[str, Tensor]:
    """Return residuals and innovations, whitened, [DRIVES, BLOCKS, Q]."""
    shape = (DRIVES, BLOCKS, len(kinds(ROVER.axles)))
    found = {name: torch.zeros(shape, dtype=torch.float64) for name in ("after", "before")}

    def watch(closed: ClosedBlocks) -> None:
        each: BlockResiduals = torch.vmap(
            lambda rows, before, after: residuals_of(MODEL, rows, before, after)
        )(closed.rows, *({n: s[n] for n in _OWN} for s in (closed.before, closed.after)))
        found["after"][closed.drives, closed.block] = whitened(each.residual, each.noise)
        found["before"][closed.drives, closed.block] = whitened(each.innovation, each.spread)

    run(MODEL, measured, torch.tensor([10 * BLOCKS - 1]), watch=watch)
    return found


_OWN = ("expected", "covariance")


def test_honest_blocks_are_white_and_a_streamed_one_has_the_same_residuals() -> None:
    """120 blocks: a mean within 0.4 is 4 deviations; the accelerometer's noise holds its bias."""
    generator = torch.Generator().manual_seed(5)
    measured = draw_tasks(ROVER, SOIL, "S1", float(BLOCKS), DRIVES, generator).measured
    found = batched(measured)
    late = found["before"][:, 2:].flatten(0, 1)
    assert (late.mean(0).abs() < 0.4).all()
    assert ((late.std(0) > 0.6) & (late.std(0) < 1.4)).all()
    state = MODEL.initial()
    with torch.inference_mode():
        for k, observation in enumerate(measured[0, : 10 * 3]):
            after = MODEL.update(state, observation)
            if after["closed"].item() > 0.0:
                block = Closed(state, torch.cat([state["block"], observation.unsqueeze(0)]), after)
                own = block_residuals(MODEL, block, kept=True)
                for name, values in (
                    ("after", whitened(own.residual, own.noise)),
                    ("before", whitened(own.innovation, own.spread)),
                ):
                    assert torch.allclose(values, found[name][0, k // 10], atol=1e-8)
            state = after


def test_whitened_residuals_have_unit_covariance_and_keep_their_rows() -> None:
    root = torch.tensor([[2.0, 0.0], [0.3, 0.1]], dtype=torch.float64)
    covariance = root @ root.T
    map_ = torch.stack([whitened(column, covariance) for column in torch.eye(2).double()], 1)
    assert torch.allclose(map_ @ covariance @ map_.T, torch.eye(2).double())
    shares = (map_ @ covariance).diagonal() / covariance.diagonal().sqrt()
    assert (shares > 0.7).all()  # correlation of each number with its own row
