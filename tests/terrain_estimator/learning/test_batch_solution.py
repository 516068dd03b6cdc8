# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The recursion against the minimum of the same sum over a whole drive, found by another method with every velocity at once.

The rows are expanded at the recursion's own answer, where Newton's method starts, too: constants are exact, the soil is known.
"""

import torch
from torch import Tensor

from terrain_estimator.block import FIXED, BlockRows, block_rows
from terrain_estimator.learning.accuracy import Drives, draw_drives, row_mask
from terrain_estimator.learning.batched import run
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.palpaca import PAlpaca
from terrain_estimator.rows import likely_inputs, regression_rows
from terramechanics.rover import load_rover
from terramechanics.soil import load_soil

DRIVES = 8
SHARED = 2 + FIXED - 2  # c, tan phi, mass, centre of mass, bias; then one velocity for each end of a block


def blocks_of(model: PAlpaca, packed: Tensor, theta: Tensor, mask: Tensor) -> list[BlockRows]:
    """Every block of a drive [T, 8 A + 9] whose observations are all linked, expanded at ``theta`` [2]."""
    contact, found = model.nominal_contact(), []
    for first in range(0, packed.shape[0], model.block_size):
        block = packed[first : first + model.block_size]
        likely = likely_inputs(block, contact, torch.cat([theta, torch.ones(1, dtype=torch.float64)]), mask)
        rows = regression_rows(block, likely, contact)
        rows = rows._replace(used=rows.used * mask)
        measured = block[:, 8 * model.axles :]
        step = measured[:, -2] * rows.used[:, 0] * measured[:, -1]
        velocity = torch.stack([measured[:, 0], measured[:, 1] ** 2], 1)
        nothing = step[:0]
        found.append(block_rows(rows, rows.features[0, ..., :0], step, velocity, nothing, model.fixed_columns, model.link_variance))
    return found


def batch_minimum(model: PAlpaca, packed: Tensor, theta: Tensor, mask: Tensor) -> Tensor:
    """(c [kPa], tan phi) [2] that minimises the sum of all blocks and the prior: Newton steps on automatic derivatives."""
    blocks = blocks_of(model, packed, theta, mask)
    mean, deviation = model.prior_mean / model.unit, model.prior_sd / model.unit
    start = torch.cat([theta, torch.zeros(SHARED - 2, dtype=torch.float64), packed[:: model.block_size, 8 * model.axles]])
    start = torch.cat([start, start[-1:]])
    rover = model.other_precision[-model.kept : -1]

    def total(k: Tensor) -> Tensor:
        homogeneous = torch.cat([k[:2], torch.ones(1, dtype=torch.float64)])
        misfit = (((k[:2] - mean) / deviation) ** 2).sum() + (rover * k[2:SHARED] ** 2).sum()
        for index, rows in enumerate(blocks):
            own = torch.cat([k[:SHARED], k[SHARED + index : SHARED + index + 2]])
            count = rows.target.shape[0]
            gram = (homogeneous @ rows.gram).view(-1, 3, count, count)[0]
            covariance = torch.einsum("a,aqp->qp", homogeneous, gram) + torch.diag(rows.variance)
            residual = rows.target - rows.offset - rows.linear @ own
            misfit = misfit + residual @ torch.linalg.solve(covariance, residual)
        return misfit

    place = start
    for _ in range(8):
        gradient, curvature = torch.func.grad(total)(place), torch.func.hessian(total)(place)
        place = place - torch.linalg.solve(curvature, gradient)
        if float(gradient @ torch.linalg.solve(curvature, gradient)) < 1e-9:
            return place[:2]
    raise AssertionError("Newton's method did not converge")


def drives() -> Drives:
    return draw_drives(load_rover("mars_rover"), load_soil("loose_sand"), "S1", DRIVES, 0.0, 31)


def test_the_recursion_is_near_the_minimum_over_the_whole_drive() -> None:
    """8 drives of 40 s, exact constants, every row: within a quarter of a deviation each, a tenth in the mean."""
    found = drives()
    model, mask = physics_alone(load_rover("mars_rover"), load_soil("loose_sand"), exact=True), row_mask("v+L+M+B", 3)
    trace = run(model, found.tasks.measured, torch.tensor([399]), found.ends, mask)
    shifts = []
    for drive in range(DRIVES):
        packed = found.tasks.measured[drive]
        if int(found.ends[drive]) < packed.shape[0] or not bool((packed[1:, -1] > 0.0).all()):
            continue
        mean = trace.mean[drive, 0] / model.unit
        deviation = trace.covariance[drive, 0].diagonal().sqrt() / model.unit
        shifts.append((mean - batch_minimum(model, packed, mean, mask)).abs() / deviation)
    shift = torch.stack(shifts)
    assert shift.shape[0] >= 6
    assert float(shift.max()) < 0.25
    assert float(shift.mean()) < 0.1
