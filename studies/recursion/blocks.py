# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The rows of one block of G drives, linear in the lifted parameters, and their noise."""

from typing import NamedTuple

import torch
from torch import Tensor

from studies.recursion.forces import ForceTable
from studies.recursion.lift import BODY, LIFTED
from terrain_estimator.model.block import fixed_columns, row_weights, velocity_twice
from terrain_estimator.model.packing import PackedView
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.rows import ContactModel, frame_of


class LiftedRows(NamedTuple):
    """Q rows of a block over P = LIFTED + BODY parameters: target = columns psi + velocity + noise.

    Row 0 is the mean of the measured velocities, row 1 carries the velocity over the block, the
    others are means of the observations' rows, as in model.block.BlockRows. The noise of columns a
    and b has the covariance overlap * (noise_a noise_b').
    """

    columns: Tensor  # [G, Q, P]
    target: Tensor  # [G, Q]
    noise: Tensor  # [G, Q, E, LIFTED] change of the columns for one deviation of each source
    overlap: Tensor  # [G, Q, Q] sum over observations of the products of their weights
    covariance: Tensor  # [G, Q, Q] of the targets, independent of the columns
    present: Tensor  # [G, Q] 1 where the row holds, else 0


def _summed(levers: Tensor, forces: Tensor) -> Tensor:
    """Return levers [G, n, A, Q, 3] times forces [G, n, A, 3, L], summed over n, [G, A, Q, L]."""
    by_axle = levers.permute(0, 2, 3, 1, 4).flatten(3)
    return by_axle @ forces.permute(0, 2, 1, 3, 4).flatten(2, 3)


class BlockMaker:
    """Makes the rows of blocks from packed observations."""

    def __init__(self, contact: ContactModel, deviations: Tensor, link_variance: float) -> None:
        """Take the contact model at the nominal constants and the constants' prior deviations."""
        axle_x = contact.geometry.axle_x
        self._contact, self._table = contact, ForceTable(contact, deviations)
        rows = row_names(axle_x.shape[0])
        self._fixed = fixed_columns(rows, float(axle_x[0] - axle_x[-1]))[:, :BODY]
        self._link_variance = link_variance

    def rows(self, packed: Tensor, counts: Tensor) -> LiftedRows:
        """Return the rows of the blocks [G, n, P].

        Observations that are 1 in ``counts`` [G, n] count, those that are 0 do not. Where not all
        count, the velocity is not carried over the block.
        """
        drives, n, _ = packed.shape
        frame = frame_of(packed.flatten(0, 1), self._contact)
        axles = frame.usable.shape[1]
        view = frame.measured
        used = (frame.used * counts.reshape(-1, 1)).view(drives, n, -1)
        linked = (used[..., 0] > 0.0).all(1)
        step = torch.where(linked.unsqueeze(1), view.step.view(drives, n), 0.0)
        weight = row_weights(used, step)  # [G, n, Q]
        forces = self._table.at(
            *(f.flatten() for f in (view.slip, view.slip_sd, view.sinkage, view.sinkage_sd))
        )
        values, by_slip, by_sinkage = (each.view(drives, n, axles, 3, LIFTED) for each in forces)
        levers = velocity_twice(frame.levers, 3).view(drives, n, axles, 2, -1, 3)
        acting, turned = levers.unbind(3)  # [G, n, A, Q, 3]
        weighted = (acting * weight[:, :, None, :, None]).permute(0, 3, 1, 2, 4).flatten(2)
        lifted = weighted @ values.flatten(1, 3)
        share = 1.0 / used[..., 0].sum(1).clamp(min=1.0)
        mean = used[..., :1, None, None] * share.view(-1, 1, 1, 1, 1)
        noise = [
            _summed(lever * mean, force)
            for lever, force in ((acting, by_slip), (acting, by_sinkage), (turned, values))
        ]  # each [G, A, Q, LIFTED]
        present = self._present(used, linked)
        fixed = self._fixed * present.unsqueeze(2)
        target, covariance = self._targets(
            frame.target, frame.variance, frame.tilt, weight, view, n
        )
        return LiftedRows(
            torch.cat([lifted, fixed], 2) * present.unsqueeze(2),
            target * present,
            torch.cat(noise, 1).transpose(1, 2) * present[..., None, None],
            weight.transpose(1, 2) @ weight,
            covariance,
            present,
        )

    def _present(self, used: Tensor, linked: Tensor) -> Tensor:
        there = (used.sum(1) > 0.0).to(used.dtype)
        carried = linked.to(used.dtype).unsqueeze(1)
        return torch.cat([carried, carried, there[:, 1:]], 1)

    def _targets(
        self,
        target: Tensor,
        variance: Tensor,
        tilt: Tensor,
        weight: Tensor,
        view: PackedView,
        n: int,
    ) -> tuple[Tensor, Tensor]:
        """Return targets [G, Q] and their covariance; the pitch's noise is not in the columns."""
        drives = weight.shape[0]

        def twice(values: Tensor) -> Tensor:
            return velocity_twice(values, 1).view(drives, n, -1)

        mean = (twice(target) * weight).sum(1)
        own = (twice(variance) * weight**2).sum(1)
        mean[:, 0] += view.velocity.view(drives, n).mean(1)
        own[:, 0] += (view.velocity_sd**2).view(drives, n).mean(1) / n
        own[:, 1] += self._link_variance
        tilted = twice(tilt) * weight
        return mean, torch.diag_embed(own) + tilted.transpose(1, 2) @ tilted
