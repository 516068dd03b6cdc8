# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The report in a state as numbers, whatever runs the model."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from terrain_estimator.observation import Floats

SCALARS = (
    "forecast",
    "forecast_variance",
    "innovation",
    "innovation_variance",
    "misfit",
    "degrees",
    "closed",
    "changed",
    "velocity",
    "velocity_variance",
)
"""Parts of the state that the report of every observation reads, in its order."""
CLOSED = SCALARS.index("closed")
"""The place among them of whether the observation closed a block, where it is above zero."""
PUBLISHED = ("strength_mean", "strength_covariance", "expected", "covariance")
"""Parts of the state from which all published numbers come."""


class Report(NamedTuple):
    """What an update told; NaN where there was no innovation or block yet."""

    forecast: float  # [m/s] velocity one step ahead
    forecast_variance: float  # [m^2/s^2]
    innovation: float  # [m/s]
    innovation_variance: float  # [m^2/s^2]
    misfit: float  # [1] squared Mahalanobis distance of the last closed block
    degrees: float  # of freedom
    closed: bool  # whether this observation closed a block
    changed: float  # [1] probability that the ground changed within the last blocks
    usable: list[bool]  # axles
    waiting: int  # observations in the block that is open beside a closed one; else 0
    finite: bool  # whether all that would be published is; a forecast may be missing (NaN)
    single_misses: Floats  # [R] of the rows of the last closed block; [0] where none was closed
    white_misses: Floats  # [R], likewise

    @property
    def distance(self) -> float:
        """Squared Mahalanobis distance of the velocity's innovation [1]."""
        # a product overflows to infinity, a power raises
        return self.innovation * self.innovation / self.innovation_variance


def report_of(
    scalars: Sequence[float],
    usable: list[bool],
    waiting: int,
    published: float,
    misses: tuple[Floats, Floats],
) -> Report:
    """Return the report of the numbers SCALARS and of what else was read.

    ``published`` is the sum of all PUBLISHED numbers where a block was closed: the posterior moves
    with closed blocks only. So does ``waiting``, the observations in a block that was opened then.
    """
    (
        ahead, variance, innovation, of_innovation, misfit, degrees, closed, changed, velocity,
        velocity_variance,
    ) = scalars  # fmt: skip
    finite = math.isfinite(velocity + velocity_variance + published)
    return Report(
        ahead, variance, innovation, of_innovation, misfit, degrees, closed > 0.0, changed, usable,
        waiting, finite and not math.isinf(ahead + variance), *misses,
    )  # fmt: skip
