# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Findings of every verdict in the form of find_missing_effect, with invented numbers."""

from functools import cache
from typing import Any

from terrain_estimator.pages.finding import finding_page

UNITS = {"drive_drag": "N m s/rad", "coulomb_drag": "N m", "slope_bias": "rad"}


@cache
def report(verdict: str) -> str:
    """Return the page about a finding."""
    return finding_page(finding(verdict))


def finding(verdict: str) -> dict[str, Any]:
    """Return a finding with everything that it can hold."""
    names = {
        "named": ["drive_drag"],
        "confusable": ["drive_drag", "coulomb_drag"],
        "unknown": ["slope_bias"],
        "none": [],
        "soil": [],
    }[verdict]
    soil = verdict == "soil"
    added = verdict in ("named", "confusable")
    return {
        "verdict": verdict,
        "probabilities": _PROBABILITIES[verdict],
        "effects": [_effect(name, verdict) for name in names],
        "confusable_with": names[1:],
        "separate_by": (
            "Drive 30 s at two speeds. For drive_drag alone: lift the wheels"
            if len(names) > 1
            else ""
        ),
        "next_drives": [_DRIVE] if len(names) > 1 else [],
        "left": (
            [{"row": "velocity", "signal": "distance", "strength": 9.1}]
            if verdict == "unknown"
            else []
        ),
        "where": [] if verdict == "none" else _WHERE,
        "soils": [_SOIL] if soil else [],
        "soil_proof": {"sentence": "the revised soils hold on held-out runs"} if soil else None,
        "gap": (
            _GAP
            if added
            else dict.fromkeys(("after", "closed", "closed_95"))
            | {"before": 1.02, "noise_floor": 1.0}
        ),
        "proof": _proof(added=added),
        "parameters": {
            "before": _STRENGTHS,
            "after": {"cohesion_pa": [3100.0, 2410.5], "tan_phi": [0.612, 0.655]},
        },
        "isolability": {
            "names": ["drive_drag", "coulomb_drag"],
            "nats": [[810.0, 12.5], [1.25, 450.0]],
            "not_testable": {"lateral_bulldozing": "it acts sideways"},
        },
        "runs": ["dune_1", "dune_2"],
        "held_out": ["dune_3"],
        "asked": {"rover": "mars_rover", "soil": "loose_sand", "seed": 0},
        "provenance": {
            "versions": {"torch": "2.13.0"},
            "sha256": {"rover": "ab" * 32},
            "runs_sha256": [["dune_1", "cd" * 32]],
        },
    }


def _proof(*, added: bool) -> dict[str, Any]:
    without = {} if added else {"after": None}
    return {
        "effect": "drive_drag" if added else "",
        "added": added,
        "sentence": (
            "drive_drag is added: rollouts miss by 1.08 instead of 1.93"
            if added
            else "nothing is added: rollouts miss by 1.02"
        ),
        "rows": [
            _score("one_step", row, region, after=added)
            for row in ("velocity", "torque_0")
            for region in ("everywhere", "uphill")
        ],
        "parameters": [_half(half, after=added) for half in (0, 1)],
        "rollouts": [
            _ROLLOUT | {"signal": "slip_0", "unit": "1"} | without,
            _ROLLOUT | without,
            _ROLLOUT | {"signal": "torque_2", "unit": "N m"} | without,
        ],
    }


_SOIL = {
    "soil": "loose_sand",
    "runs": 2,
    "file": "soils/loose_sand_found.yaml",
    "moved": ["n", "shear_modulus"],
    "constants": {
        "n": {"told": 1.1, "found": 1.013, "sd": 0.0225},
        "shear_modulus": {"told": 0.025, "found": 0.0181, "sd": 0.0005},
        "c2": {"told": 0.32, "found": 0.319, "sd": 0.0065},
    },
}
_PROBABILITIES = {
    "soil": {
        "drive_drag": 0.001,
        "coulomb_drag": 0.0,
        "slope_bias": 0.0,
        "soil": 0.98,
        "none": 0.0,
        "unknown": 0.019,
    },
    "named": {
        "drive_drag": 0.9906521,
        "coulomb_drag": 0.0091760,
        "slope_bias": 0.0,
        "none": 0.0,
        "unknown": 0.0001719,
    },
    "confusable": {
        "drive_drag": 0.55,
        "coulomb_drag": 0.44,
        "slope_bias": 0.0,
        "none": 0.002,
        "unknown": 0.008,
    },
    "unknown": {
        "drive_drag": 0.0,
        "coulomb_drag": 0.0,
        "slope_bias": 0.0004,
        "none": 0.0,
        "unknown": 0.9996,
    },
    "none": {
        "drive_drag": 0.01,
        "coulomb_drag": 0.005,
        "slope_bias": 0.005,
        "none": 0.98,
        "unknown": 0.0,
    },
}
_WHERE = [
    {
        "row": "torque_1",
        "signal": "speed",
        "region": "above 0.12 m/s",
        "strength": 0.21,
        "unit": "N m",
        "p": 3e-19,
    },
    {
        "row": "torque_0",
        "signal": "speed",
        "region": "",
        "strength": 0.14,
        "unit": "N m",
        "p": 0.0004,
    },
    {
        "row": "velocity",
        "signal": "slope",
        "region": "above 6 deg uphill",
        "strength": -0.12,
        "unit": "m/s^2",
        "p": 0.02,
    },
]
_GAP = {
    "before": 1.93,
    "after": 1.0831,
    "noise_floor": 1.0,
    "closed": 0.9107,
    "closed_95": [0.83, 0.96],
}
_STRENGTHS = {"cohesion_pa": [3699.1, 3229.07], "tan_phi": [0.485, 0.568]}
_DRIVE = {
    "name": "two_speeds",
    "words": "at two speeds",
    "seconds": 30.0,
    "nats": 17.25,
    "pair": ["drive_drag", "coulomb_drag"],
}
_ROLLOUT = {
    "run": "dune_3", "signal": "velocity", "unit": "m/s", "time_s": [0.1, 0.2, 0.3],
    "measured": [0.10, None, 0.12], "before": [0.10, 0.13, 0.16], "after": [0.10, 0.11, 0.125],
}  # fmt: skip


def _half(half: int, *, after: bool) -> dict[str, Any]:
    def pair(before: float, then: float) -> list[float | None]:
        return [before, then if after else None]

    means = {"cohesion_pa": pair(3600.0, 3050.0 + 20.0 * half), "tan_phi": pair(0.49, 0.61)}
    deviations = {"cohesion_pa_sd": pair(210.0, 180.0), "tan_phi_sd": pair(0.02, 0.01)}
    return {"run": "dune_3", "half": half} | means | deviations


def _effect(name: str, verdict: str) -> dict[str, Any]:
    probability = _PROBABILITIES[verdict][name]
    return {
        "name": name,
        "coefficient": 0.2005080,
        "sd": 0.0031568,
        "unit": UNITS[name],
        "probability": probability,
        "log_bayes_factor": 1036.1,
    }


def _score(kind: str, row: str, region: str, *, after: bool) -> dict[str, Any]:
    def pair(before: float, then: float) -> list[float | None]:
        return [before, then if after else None]

    score = {"error": pair(0.31, 0.16), "nll": pair(1.2, -0.3), "coverage": pair(0.7, 0.95)}
    return {
        "kind": kind,
        "row": row,
        "region": region,
        "unit": "m/s",
        "count": 118,
        "noise_floor": 0.15,
    } | score
