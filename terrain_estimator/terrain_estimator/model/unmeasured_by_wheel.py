# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sinkages of single wheels that no sensor measures.

Load, moment and joints give one balance for each axle, which has two wheels, so torques of the
others are spent, too. (The roll moment would do for one of them, but the lateral velocity has a
large error in it.) With b these rows and z the relative change of the missing sinkages, which is
known to a deviation s,

    h - T b,    T = s^2 dh/dz (db/dz)' (s^2 db/dz (db/dz)' + V)^-1,

where V is the variance of b. T b is taken off every other row h, with all its columns, whatever T
is; this T leaves least of the sinkages in it (the gain of a Kalman step). What is left of them, as
where a wheel hardly slips and its torque hardly depends on its load, stays a source of noise.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from terrain_estimator.model.gaussian import cholesky
from terrain_estimator.model.row_names import ROLL_MOMENT
from terrain_estimator.model.rows import ContactModel, Frame, Rows
from terrain_estimator.model.unmeasured import (
    DEEPEST,
    SEARCHES,
    SHALLOWEST,
    SMALL,
    at_once,
    usual_sinkage,
)
from terramechanics.contact.rolling import WheelMotion, rolling_forces

UNKNOWN = 1.0
"""[1] Deviation of the relative change of a missing sinkage."""
EVEN = 0.3
"""[1] The same in the search for the place of expansion: sinkages are alike if nothing tells."""
BALANCED = 1e-3
"""[1] Smallest deviation of a row in that search, in units of m g or m g b."""


def found_sinkage(
    frame: Frame,
    motion: WheelMotion,
    missing: Tensor,
    contact: ContactModel,
    theta: Tensor,
    telling: Tensor,
    searches: int = SEARCHES,
    small: float = SMALL,
    shallowest: float = SHALLOWEST,
    deepest: float = DEEPEST,
    alike: float = EVEN**-2,
    balanced: float = BALANCED,
) -> Tensor:
    """Return sinkages [n, W] [m] that the ``telling`` rows [K] make most likely, where ``missing``.

    The search begins at those of the frame.

    The ``motion`` is that of all wheels [n, W], ``theta`` [3] is (c [kPa], tan phi, 1). By
    Gauss-Newton steps in the logarithms of the sinkages.
    """
    measured = frame.measured.sinkage
    usual = torch.log(usual_sinkage(contact))
    depth = torch.log(measured)
    levers = frame.levers.select(2, 0).index_select(2, telling)  # [n, W, K, 4]
    target = frame.target.index_select(1, telling)
    spread = torch.sqrt(frame.variance.index_select(1, telling)).clamp(min=balanced)
    used = frame.used.index_select(1, telling) / spread
    sought = missing.to(depth.dtype)
    known = torch.diag_embed(torch.full_like(depth, alike))
    low = torch.log(torch.full_like(depth, shallowest * contact.radius))
    high = torch.log(torch.full_like(depth, deepest * contact.radius))
    for _ in range(searches):
        both = torch.exp(torch.stack([depth, depth + small]))
        evaluated = rolling_forces(
            motion, both, contact.constants, contact.radius, contact.width, contact.nodes
        )
        acting = (levers @ ((evaluated * contact.column_unit) @ theta).unsqueeze(-1)).squeeze(-1)
        value, deeper = acting.unbind(0)  # [n, W, K]
        by_depth = ((deeper - value) / small).transpose(1, 2) * used.unsqueeze(2)
        by_depth = by_depth * sought.unsqueeze(1)
        lacking = (target - value.sum(1)) * used
        pulled = (by_depth.transpose(1, 2) @ lacking.unsqueeze(2)).squeeze(2)
        pulled = pulled + (usual - depth) * sought * alike
        factor = cholesky(by_depth.transpose(1, 2) @ by_depth + known)
        step = torch.cholesky_solve(pulled.unsqueeze(2), factor).squeeze(2)
        depth = torch.minimum(torch.maximum(depth + step.clamp(-1.0, 1.0), low), high)
    return torch.where(missing, torch.exp(depth), measured)


def spent_on_sinkage(
    rows: Rows,
    missing: Tensor,
    theta: Tensor,
    spent: Tensor,
    kept: Tensor,
    unknown: float = UNKNOWN / SMALL,
) -> Rows:
    """Return ``rows`` without the ``spent`` ones [K] and, as far as these tell them, the sinkages.

    ``kept`` [R] is 0 for the spent rows and 1 for the others. The rows are at the sinkages at which
    the balances hold for ``theta`` [3], which is (c [kPa], tan phi, 1). Those that are ``missing``,
    bool [n, W], have the deviation SMALL in ``rows``, of which ``unknown`` make the true one. The
    result holds the multiples in ``taken`` [n, R, K], and K sources of noise more, of the spent
    rows.
    """
    wheels, every = missing.shape[1], missing.any(1)
    sought = missing.to(theta.dtype).unsqueeze(1)
    by_depth = (rows.noise[0].narrow(2, wheels, wheels) @ theta) * (unknown * sought)  # [n, R, W]
    own = by_depth.index_select(1, spent)  # [n, K, W]
    variance = rows.variance.index_select(1, spent)
    factor = cholesky(own @ own.transpose(1, 2) + torch.diag_embed(variance + 1e-12))
    taken = torch.cholesky_solve(own @ by_depth.transpose(1, 2), factor).transpose(1, 2)

    features = rows.features - taken @ rows.features.index_select(2, spent)
    noise = rows.noise - (taken @ rows.noise.index_select(2, spent).flatten(3)).view(
        rows.noise.shape
    )
    bent = every.view(1, -1, 1, 1)
    features = torch.where(bent, at_once(features, theta), features)
    noise = torch.where(bent.unsqueeze(-1), at_once(noise, theta), noise)
    # what is left of the sinkages does not depend on theta: its parts by c and tan phi cancel
    left = nn.functional.pad((by_depth - taken @ own).unsqueeze(-1), [2, 0])
    slips, depths, others = noise.split_with_sizes([wheels, wheels, noise.shape[3] - 2 * wheels], 3)
    left = nn.functional.pad(left.unsqueeze(0), [0, 0, 0, 0, 0, 0, 0, 0, 0, noise.shape[0] - 1])
    depths = torch.where(missing.view(1, -1, 1, wheels, 1), left, depths)
    # the rows share the errors of the spent torques
    read = nn.functional.pad((taken * torch.sqrt(variance).unsqueeze(1)).unsqueeze(-1), [2, 0])
    read = nn.functional.pad(read.unsqueeze(0), [0, 0, 0, 0, 0, 0, 0, 0, 0, noise.shape[0] - 1])
    noise = torch.cat([slips, depths, others, read], 3)
    target = rows.target - (taken @ rows.target.index_select(1, spent).unsqueeze(2)).squeeze(2)
    there = rows.used.index_select(1, spent).amin(1, keepdim=True)
    used = torch.where(every.unsqueeze(1), rows.used * kept * there, rows.used)
    return Rows(features, noise, target, rows.variance, used, taken)


def without_spent(columns: Tensor, taken: Tensor, spent: Tensor) -> Tensor:
    """Return ``columns`` [n, R, K] less the multiples ``taken`` [n, R, S] of ``spent`` rows [S]."""
    return columns - taken @ columns.index_select(1, spent)


def spent_rows(rows: Sequence[str], axles: list[int]) -> tuple[list[int], list[int]]:
    """Return the places of the rows that missing sinkages cost, and of those that tell them.

    ``axles`` are those of the wheels, front to rear, left before right. Kept are the roll moment,
    in which the lateral velocity has a large error, and the torque of the last wheel of each axle:
    the other balances tell its load, if those of the others are known.
    """
    telling = [place for place, row in enumerate(rows) if row == "load" or "moment" in row]
    kept = {len(axles) - 1 - axles[::-1].index(axle) for axle in set(axles)}
    torques = [f"torque_{wheel}" for wheel in range(len(axles)) if wheel not in kept]
    balances = [place for place in telling if rows[place] != ROLL_MOMENT]
    return [*balances, *map(rows.index, torques)], telling
