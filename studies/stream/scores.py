# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Errors, intervals and status of c or tan phi in streamed drives, with 99 % limits."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import norm

from studies.accuracy.scores import CONFIDENCE, HALF_NORMAL_MEDIAN, share_of
from studies.limited import Limited
from studies.quantiles import quantile_of
from studies.stream.drives import Streamed
from terrain_estimator.estimator.summary import IDENTIFIED_VARIANCE
from terrain_estimator.model.prior import DEFAULT_PRIOR

PRIOR_SD = (DEFAULT_PRIOR.cohesion_sd_pa, DEFAULT_PRIOR.tan_phi_sd)


@dataclass(frozen=True, slots=True)
class StrengthScore:
    """c or tan phi after one time; errors are relative to the truth.

    NaN without a bound, None without a drive of that kind.
    """

    median_error: float
    p90_error: float
    bound: float  # median error of an estimator that reaches the Cramer-Rao bound
    of_bound: Limited  # median of |error| over that of the bound, 1 for an efficient estimator
    inside_95: Limited  # of the published interval
    inside_68: Limited | None  # one deviation; of the drives that published an estimate
    shift: Limited  # mean of error over published deviation
    identified: float  # share of drives
    # of the drives whose bound leaves at most IDENTIFIED_VARIANCE of the prior's
    identified_of_known: Limited | None
    known: int  # such drives


def strength_score(streamed: Streamed, place: int, k: int) -> StrengthScore:
    """Return the score of parameter ``k`` (0 c, 1 tan phi) after the time at ``place`` of K.

    Each drive counts once, with the last values that were published up to that time.
    """
    truth, deviation = streamed.truth[:, k], streamed.deviation[:, place, k]
    error = streamed.mean[:, place, k] - truth
    z, relative = error / deviation, np.abs(error) / truth
    least, identified = streamed.least[:, place, k], streamed.identified[:, place, k] > 0.0
    known = least**2 <= IDENTIFIED_VARIANCE * PRIOR_SD[k] ** 2
    median, high = np.quantile(relative, (0.5, 0.9)).tolist()
    half = norm.isf(0.5 * (1.0 - CONFIDENCE)) * float(z.std(ddof=1)) / math.sqrt(len(z))
    shift = float(z.mean())
    return StrengthScore(
        median,
        high,
        HALF_NORMAL_MEDIAN * float(np.median(least / truth)),
        quantile_of(np.abs(error) / least / HALF_NORMAL_MEDIAN, 0.5),
        _share(streamed.inside_95[:, place, k] > 0.0),
        _share_where(np.abs(z) < norm.ppf(0.84), streamed.published > 0.0),
        Limited(shift, shift - half, shift + half),
        float(identified.mean()),
        _share_where(identified, known),
        int(known.sum()),
    )


def _share(flags: NDArray[np.bool_]) -> Limited:
    return share_of(torch.from_numpy(np.ascontiguousarray(flags)))


def _share_where(flags: NDArray[np.bool_], where: NDArray[np.bool_]) -> Limited | None:
    return _share(flags[where]) if where.any() else None
