# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measurements on a testbed that would separate effects which its tables confuse."""

from collections.abc import Sequence
from itertools import combinations

from terrain_estimator.discovery.hypotheses.library import Hypothesis

_PAIRS = {
    frozenset(
        {"bulldozing", "slip_sinkage"}
    ): "the same depth at two slips: the wedge depends on depth alone",
    frozenset(
        {"slip_sinkage", "rate_dependence"}
    ): "reach the same slip at two speeds of the carriage",
}
_ALONE = {
    "bulldozing": "two loads at equal slip, so that the depth differs",
    "grousers": "slips from 0 to 0.4 at one load",
    "slip_sinkage": "two slips at equal load",
    "rate_dependence": "reach the same slip at two speeds of the carriage",
    "lateral_bulldozing": "two loads at one slip angle, so that the depth of the side differs",
    "exit_angle": "measure the rut's depth behind the wheel against the wheel's sinkage",
}
"""By effect that one wheel shows."""


def separate_by(hypotheses: Sequence[Hypothesis]) -> str:
    """Return the measurements that would separate these hypotheses; empty for fewer than two."""
    names = sorted({name for hypothesis in hypotheses for name in hypothesis.names})
    advice = []
    for first, second in combinations(names, 2):
        known = _PAIRS.get(frozenset({first, second}))
        advice.append(f"{first} or {second}: {known or f'{_ALONE[first]}; {_ALONE[second]}'}")
    return ". ".join(advice)
