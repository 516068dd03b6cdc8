# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Entries of named effects in finding.json, for drives and wheels alike."""

from collections.abc import Iterable
from typing import Any

from terramechanics.effects import describe


def effect_entries(
    sizes: Iterable[tuple[str, float, float]], probability: float, log_bayes_factor: float
) -> list[dict[str, Any]]:
    """Return the entries of one hypothesis in ``effects``; ``sizes`` are name, mean and sd."""
    return [
        {
            "name": name,
            "coefficient": size,
            "sd": sd,
            "unit": describe(name).unit,
            "probability": probability,
            "log_bayes_factor": log_bayes_factor,
        }
        for name, size, sd in sizes
    ]
