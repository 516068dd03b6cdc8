# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A measured figure with its confidence limits, as every study reports it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Limited:
    """A figure with its limits; which ones, and how sure, says who makes it."""

    value: float
    low: float
    high: float
