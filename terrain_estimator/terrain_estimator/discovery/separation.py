# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What would tell effects apart that the runs at hand do not: a manoeuvre for each pair, from what their laws depend on."""

from collections.abc import Sequence
from itertools import combinations

from terrain_estimator.discovery.library import Hypothesis

_MANOEUVRES = {
    frozenset({"multipass", "payload"}): "drive off the own track (crab or turn), then on it: the rut disappears, the load stays",
    frozenset({"slip_sinkage", "rate_dependence"}): "reach the same slip at two speeds, on the flat and on a slope",
    frozenset({"drive_drag", "rate_dependence"}): "lift or coast the wheels at several rates: drag stays without soil",
    frozenset({"drive_drag", "coulomb_drag"}): "drive at two speeds that differ by a factor of three: dry friction does not change",
    frozenset({"odometry_scale", "grousers"}): "a leg on firm ground: a wrong radius keeps its share of slip there, lugs do not bite",
    frozenset({"odometry_scale", "slip_sinkage"}): "a leg on firm ground at low slip: a wrong radius keeps its share of slip there",
    frozenset({"slope_bias", "bulldozing"}): "drive the same slope in both headings: a tilted sensor changes its sign, resistance does not",
    frozenset({"slope_bias", "payload"}): "drive the same slope in both headings, and stand still on it",
    frozenset({"bulldozing", "slip_sinkage"}): "the same depth at two slips: the wedge depends on depth alone",
    frozenset({"sinkage_bias", "exit_angle"}): "a leg on firm ground: a bias of the camera stays, rebound does not",
    frozenset({"sinkage_bias", "payload"}): "a leg on firm ground: a bias of the camera stays where nothing sinks in",
}
_ALONE = {
    "slope_bias": "stand still on the flat in two headings",
    "bulldozing": "drive through loose soil at two depths and equal slip",
    "drive_drag": "coast, or drive at two speeds that differ by a factor of three",
    "coulomb_drag": "start from rest on firm ground and compare torques of both directions",
    "payload": "stand still on scales, or accelerate at two levels",
    "grousers": "drive at slips from 0 to 0.4 on a slope",
    "slip_sinkage": "drive at two slips with equal load",
    "multipass": "drive off the own track, then on it",
    "odometry_scale": "drive a leg on firm ground",
    "failed_wheel": "drive each axle alone",
    "sinkage_bias": "drive a leg on firm ground",
    "latency": "start and stop sharply",
    "rate_dependence": "reach the same slip at two speeds",
    "exit_angle": "measure the rut's depth behind a wheel against the wheel's sinkage",
}


def separate_by(hypotheses: Sequence[Hypothesis]) -> str:
    """The manoeuvres that would separate these hypotheses; empty for fewer than two."""
    names = sorted({name for hypothesis in hypotheses for name in hypothesis.names})
    advice = []
    for first, second in combinations(names, 2):
        known = _MANOEUVRES.get(frozenset({first, second}))
        advice.append(f"{first} or {second}: {known or f'{_ALONE[first]}; {_ALONE[second]}'}")
    return ". ".join(advice)
