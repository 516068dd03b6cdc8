# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The sum that the recursion minimises by block, over a whole drive: minimum and posterior.

    k = [c (kPa), tan phi, M soil constants (prior deviations), mass, centre of mass,
         acceleration bias, velocities]

has one velocity for each end of the B blocks. The rows of a block and their noise are the model's,
evaluated where a method says.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from studies.batched import lay_out
from terrain_estimator.model.block import FIXED, BlockRows
from terrain_estimator.model.packing import view_of, without_link
from terrain_estimator.model.palpaca import PAlpaca

POINTS, REACH = 13, 4.2
"""Points of a grid along each axis, and its half width in standard deviations."""
CHUNK = 64
"""Points that are solved at once."""
STAYS = 0.05
"""[standard deviations] by which what a grid finds may still move."""


class Belief(NamedTuple):
    """The posterior of the ground from one drive, if it is of one soil."""

    log_evidence: Tensor  # [] up to a constant that all soils share; of c and tan phi above zero
    mean: Tensor  # [2] c [kPa], tan phi
    covariance: Tensor  # [2, 2]


def in_one_chain(model: PAlpaca, packed: Tensor) -> Tensor:
    """Return which of the drives [N, T, P] have every velocity linked to the one before [N]."""
    layout = lay_out(model, packed, torch.full((packed.shape[0],), packed.shape[1]))
    return layout.linked[:, 1:].all(1)


class WholeDrive:
    """The sum over one drive [10 B, size] in one chain, on one soil of a model without a net."""

    def __init__(
        self, model: PAlpaca, packed: Tensor, mask: Tensor | None = None, soil: int = 0
    ) -> None:
        """``mask`` [R] is 1 for the rows that may be used."""
        self._model, self._soil = model, soil
        self._mask = model.every_row if mask is None else mask
        # the first observation covers no time
        packed = torch.cat([without_link(packed[:1]), packed[1:]])
        self._blocks = packed.view(-1, model.block_size, packed.shape[1])
        self.place = 2 + model.layout.constants  # parameters that say where rows are evaluated
        self._prior, unit = model.hypotheses, model.hypotheses.unit
        self._mean, self._deviation = self._prior.prior_mean / unit, self._prior.prior_sd / unit
        velocity = view_of(packed, model.axles).velocity
        self._velocity = torch.cat([velocity[:: model.block_size], velocity[-1:]])
        known = (
            torch.ones(model.layout.constants, dtype=torch.float64),
            self._prior.rover_precision[:-1],
        )
        self._precision = torch.cat([*known, torch.full_like(self._velocity, 1e-6)])

    def start(self, place: Tensor) -> Tensor:
        """Return k with ``place`` [2 + M], measured velocities, and the rover of the file.

        ``place`` is c, tan phi and constants.
        """
        return torch.cat([place, place.new_zeros(FIXED - 2), self._velocity])

    def rows(self, place: Tensor) -> BlockRows:
        """Return rows [B, ...] at one ``place`` [2 + M] of k, or one for each block [B, 2 + M]."""
        place = place.expand(self._blocks.shape[0], self.place)
        return torch.vmap(
            lambda block, at: self._model.average(block, self._soil, at, self._mask)[0]
        )(self._blocks, place)

    def minimum(self, k: Tensor) -> Tensor:
        """Return k where the sum is least, the prior's Gaussian of (c, tan phi) included.

        Newton steps on automatic derivatives from ``k``; before each the rows are evaluated anew,
        at the k that it starts from.
        """

        def total(k: Tensor, rows: BlockRows) -> Tensor:
            return self._misfit(k, rows) + (((k[:2] - self._mean) / self._deviation) ** 2).sum()

        for _ in range(12):
            rows = self.rows(k[: self.place])
            gradient, curvature = (
                torch.func.grad(total)(k, rows),
                torch.func.hessian(total)(k, rows),
            )
            step = torch.cholesky_solve(
                gradient.unsqueeze(1), torch.linalg.cholesky(curvature)
            ).squeeze(1)  # raises at a saddle
            k = k - step
            if float(gradient @ step) < 1e-6:
                return k
        raise AssertionError("Newton's method did not converge")

    def belief(self, place: Tensor, covariance: Tensor, expanded: Tensor | None = None) -> Belief:
        """Return the posterior on a grid of (c, tan phi).

        At each point all else is solved for and marginalised as a Gaussian. The grid starts at
        ``place`` [2 + M] with ``covariance`` [2, 2], the place of c, tan phi and constants, and is
        laid again around what it finds until that stays. Rows are evaluated at that place, or at
        those ``expanded`` [B, 2 + M].
        """
        scale, axis = (
            torch.linalg.cholesky(covariance),
            torch.linspace(-REACH, REACH, POINTS, dtype=torch.float64),
        )
        square, unit = torch.cartesian_prod(axis, axis), torch.eye(2, dtype=torch.float64)
        for _ in range(12):
            rows = self.rows(place if expanded is None else expanded)
            theta = place[:2] + square @ scale.T
            log_density, known = torch.vmap(
                self._solved, in_dims=(0, None, None), chunk_size=CHUNK
            )(theta, place[2:], rows)
            log_density = log_density + self._log_prior(theta)
            weight = torch.softmax(log_density, 0)
            found, moments = torch.cat([weight @ theta, weight @ known]), weight @ square
            spread = (square - moments).T @ (
                weight.unsqueeze(1) * (square - moments)
            )  # in units of the scale
            moved = torch.cat([moments, found[2:] - place[2:]])
            if float(moved.abs().max()) < STAYS and float((spread - unit).abs().max()) < 0.3:
                possible = (
                    log_density[(theta > 0.0).all(1)].logsumexp(0) + scale.diagonal().log().sum()
                )
                return Belief(possible, found[:2], scale @ spread @ scale.T)
            step = float(axis[1] - axis[0])
            # of a posterior that is narrower than a step nothing is seen but its place
            place, scale = found, scale @ torch.linalg.cholesky(spread + unit * step**2 / 12.0)
        raise AssertionError("the grid did not come to rest")

    def _solved(self, theta: Tensor, known: Tensor, rows: BlockRows) -> tuple[Tensor, Tensor]:
        """Return the log density of the rows at ``theta`` [2], and the soil constants there.

        A second step allows for the noise, which depends on these.
        """
        k = self.start(torch.cat([theta, known]))
        columns, free = self._columns(k, rows), k[2:]
        whitened = torch.linalg.solve(self._covariance(k, rows), columns)
        factor = torch.linalg.cholesky((columns.mT @ whitened).sum(0) + torch.diag(self._precision))
        gradient = self._precision * free - torch.einsum(
            "bqz,bq->z", whitened, self._residual(k, rows)
        )
        free = free - torch.cholesky_solve(gradient.unsqueeze(1), factor).squeeze(1)
        slope, misfit = torch.func.grad_and_value(
            lambda free: self._misfit(torch.cat([theta, free]), rows)
        )(free)
        step = 0.5 * torch.cholesky_solve(slope.unsqueeze(1), factor).squeeze(1)
        return (
            -0.5 * (misfit - 0.5 * slope @ step) - factor.diagonal().log().sum(),
            (free - step)[: self.place - 2],
        )

    def _log_prior(self, theta: Tensor) -> Tensor:
        """Return the log prior [P] of (c, tan phi) [P, 2]: the mixture of parts above zero."""
        centre, deviation = (
            self._mean + self._prior.offsets * self._deviation,
            self._prior.offset_spread * self._deviation,
        )
        possible = torch.special.log_ndtr(centre / deviation).sum(1)
        distance = ((theta.unsqueeze(1) - centre) / deviation).square().sum(-1)
        return torch.logsumexp(self._prior.offset_log_weight - possible - 0.5 * distance, 1)

    def _misfit(self, k: Tensor, rows: BlockRows) -> Tensor:
        """r' S^-1 r of all blocks, and the prior of all but c and tan phi."""
        residual = self._residual(k, rows)
        whitened = torch.linalg.solve(self._covariance(k, rows), residual)
        return (residual * whitened).sum() + (self._precision * k[2:] ** 2).sum()

    def _residual(self, k: Tensor, rows: BlockRows) -> Tensor:
        """[B, Q]"""
        from_expansion = k[2:] - nn.functional.pad(rows.expansion, [0, k.shape[0] - self.place])
        explained = rows.linear[..., :2] @ k[:2] + (
            self._columns(k, rows) @ from_expansion.unsqueeze(-1)
        ).squeeze(-1)
        return rows.target - rows.offset - explained

    def _columns(self, k: Tensor, rows: BlockRows) -> Tensor:
        """Return the columns [B, Q, D - 2] of all but c and tan phi, at those of ``k``."""
        blocks, q = rows.target.shape
        by_constant = torch.einsum("a,bax->bx", _homogeneous(k), rows.nuisance).view(blocks, q, -1)
        ends = torch.eye(blocks + 1, dtype=k.dtype).unsqueeze(1)
        velocity = rows.linear[..., -2:-1] * ends[:-1] + rows.linear[..., -1:] * ends[1:]
        return torch.cat([by_constant, rows.linear[..., -FIXED:-2], velocity], 2)

    def _covariance(self, k: Tensor, rows: BlockRows) -> Tensor:
        """Return S [B, Q, Q] at the c and tan phi of ``k`` and the constants of the rows.

        It has derivatives by the constants of ``k``.
        Their values do not enter: S to first order in them need not be definite.
        """
        blocks, q = rows.target.shape
        theta, gram = _homogeneous(k), rows.gram.view(blocks, 3, -1, 3, q, q)
        half = torch.einsum("ad,bacdqp->bcqp", theta.unsqueeze(1) * theta, gram)
        known = k[2 : self.place]
        change = torch.einsum("c,bcqp->bqp", known - known.detach(), half[:, 1:])
        return half[:, 0] + change + change.mT + torch.diag_embed(rows.variance)


def _homogeneous(k: Tensor) -> Tensor:
    return torch.cat([k[:2], torch.ones_like(k[:1])])
