# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Where all rows of an instant agree best on slip and sinkage: the place at which they are expanded."""

from typing import NamedTuple

import torch
from torch import Tensor

from terrain_estimator.model.gaussian import cholesky
from terrain_estimator.model.packing import view_of, with_sinkage, with_slip
from terrain_estimator.model.rows import ContactModel, Rows, are_usable

LARGEST_ERROR = 3.0
"""[standard deviations] by which an input is moved at most."""


class Agreement(NamedTuple):
    """Where all rows of an instant agree best, of n observations."""

    inputs: Tensor  # [n, P] packed observations with slips and sinkages there
    doubt: Tensor  # [n, 3, A] variances of what is left of the errors of slip and sinkage, in those as measured, and their covariance


def agreement(
    rows: Rows,
    packed: Tensor,
    contact: ContactModel,
    theta: Tensor,
    chosen: Tensor,
    largest: float = LARGEST_ERROR,
) -> Agreement:
    """Slips and sinkages where the ``rows``, taken at the measured ones, agree best, given ``theta`` = (c [kPa], tan phi, 1).

    One step of the projection that orthogonal distance regression makes, e = G' S^-1 r, by the rows
    that are ``chosen`` [R] (1 or 0), without the velocity's, whose dv/dt no single instant
    measures. What is left has the covariance I - G' S^-1 G. As a place to expand the rows around,
    it need not be exact, nor ``theta``.
    """
    axles, others = contact.geometry.axle_x.shape[0], rows.used.shape[1] - 1
    used = (rows.used * chosen).narrow(1, 1, others)
    noise = (rows.noise[0] @ theta).narrow(1, 1, others) * used.unsqueeze(-1)
    residual = (rows.target - rows.features[0] @ theta).narrow(1, 1, others) * used
    own = rows.variance.narrow(1, 1, others) * used + (1.0 - used)
    factor = cholesky(noise @ noise.transpose(1, 2) + torch.diag_embed(own))
    white = torch.linalg.solve_triangular(
        factor, torch.cat([noise, residual.unsqueeze(-1)], 2), upper=False
    )
    told, surprise = white.split_with_sizes([noise.shape[2], 1], 2)
    error = (told * surprise).sum(1)
    faster, deeper, _ = error.clamp(-largest, largest).split_with_sizes(
        [axles, axles, axles + 1], 1
    )
    view = view_of(packed, axles)
    moved = view.slip + view.slip_sd * faster
    sunk = torch.maximum(view.sinkage + view.sinkage_sd * deeper, 0.3 * view.sinkage)
    possible = are_usable(moved, sunk, view.contact_angle, contact)
    moved = torch.where(possible, moved, view.slip)
    sunk = torch.where(possible, sunk, view.sinkage)
    of_slip, of_sinkage, _ = told.split_with_sizes([axles, axles, axles + 1], 2)
    left = [
        1.0 - (of_slip * of_slip).sum(1),
        1.0 - (of_sinkage * of_sinkage).sum(1),
        -(of_slip * of_sinkage).sum(1),
    ]
    return Agreement(with_sinkage(with_slip(packed, moved), sunk), torch.stack(left, 1))
