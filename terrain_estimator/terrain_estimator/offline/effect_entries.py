# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Entries of named effects in finding.json, for drives and wheels alike."""

from collections.abc import Iterable
from typing import Any

from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.single_wheel.cells import ROWS, UNITS
from terrain_estimator.discovery.single_wheel.size import Change

_UNITS = dict(zip(ROWS, UNITS, strict=True))


def effect_entries(
    hypothesis: Hypothesis,
    sizes: Iterable[tuple[str, float, float]],
    probability: float,
    log_bayes_factor: float,
) -> list[dict[str, Any]]:
    """Return the entries of one hypothesis in ``effects``.

    ``sizes`` are name, mean and deviation of each of its effects, in the unit of its law.
    """
    return [
        {
            "name": name,
            "coefficient": size,
            "sd": sd,
            "unit": effect.unit,
            "probability": probability,
            "log_bayes_factor": log_bayes_factor,
        }
        for effect, (name, size, sd) in zip(hypothesis.effects, sizes, strict=True)
    ]


def change_entry(change: Change) -> dict[str, Any]:
    """Return what an effect changes of one wheel, with the ends of 95 % intervals."""
    rows = {
        name: interval_entry(ends) | {"unit": _UNITS[name]} for name, ends in change.rows.items()
    }
    return {"slip": change.slip, "load_n": change.load, "rows": rows}


def interval_entry(interval: tuple[float, float, float]) -> dict[str, float]:
    """Return lower end, median and upper end of a 95 % interval."""
    return dict(zip(("low", "median", "high"), interval, strict=True))
