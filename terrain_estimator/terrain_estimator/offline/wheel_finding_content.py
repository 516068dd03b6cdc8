# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Content of finding.json about one wheel on a testbed, and the verdict in words."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from terrain_estimator.discovery.evidence.verdict import Verdict
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.single_wheel.cells import ROWS, UNITS, Cells, Rig, Row, cells_of
from terrain_estimator.discovery.single_wheel.fit import Explained
from terrain_estimator.discovery.single_wheel.investigation import FLOOR, HeldOut, WheelFinding
from terrain_estimator.observation import Floats
from terrain_estimator.offline.effect_entries import effect_entries
from terrain_estimator.pages.wheel_finding import undescribed

NOT_IDENTIFIED = (
    "c and tan phi are not identified: these tables have no drive torque, so both were left free"
    " and are not reported"
)
NOT_DESCRIBED = (
    "c and tan phi are not reported: the model does not describe these tables, so what it would"
    " say of the soil means nothing"
)
OF_THE_LAW = (
    "c and tan phi are those with which this contact law fits, at the soil file's constants"
)
NORMAL_95 = float(norm.ppf(0.975))
REPLICATES = "replicates of one setting count as one measurement"


def wheel_content(
    outcome: WheelFinding,
    bed: Rig,
    rows: Sequence[Row],
    reference: frozenset[str],
    given: Hypothesis,
    tables: Sequence[Path],
    *,
    by_trial: bool,
    seed: int,
) -> dict[str, Any]:
    """Return the content of finding.json, in the form of the findings about drives."""
    judgement, cells = outcome.judgement, cells_of(rows, reference)
    tried = int(cells.acts.sum())
    return {
        "verdict": str(judgement.verdict),
        "probabilities": judgement.probabilities,
        "effects": [
            entry for hypothesis in judgement.named for entry in _effects(outcome, hypothesis)
        ],
        "confusable_with": [each.label for each in judgement.named[1:]],
        "separate_by": outcome.separate_by,
        "where": [],
        "left": (
            [dict(zip(("row", "signal"), outcome.left, strict=True))]
            if judgement.verdict is Verdict.UNKNOWN
            else []
        ),
        "gap": _gap(outcome, bed, seed),
        "parameters": _parameters(outcome, cells),
        "runs": [path.name for path in tables],
        "held_out": ["each trial in turn" if by_trial else f"each of {tried} settings in turn"],
        "rows": [name for name, seen in zip(ROWS, cells.seen.any(0).tolist(), strict=True) if seen],
        "settings": len(cells.slip),
        "measurements": len(rows),
        "given": list(given.names),
        "limits": [_limit(outcome, cells), REPLICATES],
    }


def _limit(outcome: WheelFinding, cells: Cells) -> str:
    """Return what has to be known about c and tan phi."""
    if not bool(cells.seen[:, ROWS.index("torque")].any()):
        return NOT_IDENTIFIED
    return OF_THE_LAW if outcome.held_out.described else NOT_DESCRIBED


def _parameters(outcome: WheelFinding, cells: Cells) -> dict[str, Any]:
    """Return mean and standard deviation of c [Pa] and tan phi, and why there are none."""
    why = _limit(outcome, cells)
    if why != OF_THE_LAW:
        return {"before": None, "after": None, "why": why}
    named = outcome.judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
    after = _strength(outcome.found[0]) if named else None
    return {"before": _strength(outcome.nothing), "after": after, "why": why}


def _strength(found: Explained) -> dict[str, float]:
    (cohesion, cohesion_sd), (tan_phi, tan_phi_sd) = found.strength()
    return {
        "cohesion_pa": cohesion,
        "cohesion_sd_pa": cohesion_sd,
        "tan_phi": tan_phi,
        "tan_phi_sd": tan_phi_sd,
    }


def _effects(outcome: WheelFinding, hypothesis: Hypothesis) -> list[dict[str, Any]]:
    found = next(each for each in outcome.found if each.hypothesis == hypothesis)
    probability = outcome.judgement.probabilities.get(" + ".join(hypothesis.names), 0.0)
    factor = found.log_evidence - outcome.nothing.log_evidence
    return effect_entries(found.sizes(outcome.first), probability, factor)


def _gap(outcome: WheelFinding, bed: Rig, seed: int) -> dict[str, Any]:
    """Return the gap on held-out settings: in deviations of repeatability, and by row in units."""
    errors = outcome.held_out
    before, after = errors.rms(bed.repeatability)
    interval = errors.improvement_95(bed.repeatability, seed)
    room = before - FLOOR
    return {
        "before": before,
        "after": after,
        "noise_floor": FLOOR,
        "closed": None if after is None or room <= 0.0 else (before - after) / room,
        "closed_95": None if interval is None or room <= 0.0 else [end / room for end in interval],
        "rows": _gap_by_row(errors, bed),
        "proven": outcome.proven,
        "described": errors.described,
        "settings": errors.settings,
    }


def _gap_by_row(errors: HeldOut, bed: Rig) -> dict[str, dict[str, Any]]:
    rows = {}
    for k, (name, unit) in enumerate(zip(ROWS, UNITS, strict=True)):
        seen = ~np.isnan(errors.before[:, k])
        if seen.any():
            rows[name] = {
                "before": _rms(errors.before[seen, k]),
                "after": None if errors.after is None else _rms(errors.after[seen, k]),
                "noise_floor": bed.repeatability[k],
                "unit": unit,
            }
    return rows


def _rms(errors: Floats) -> float:
    return float((errors**2).mean() ** 0.5)


def _strength_words(parameters: Mapping[str, Any]) -> str:
    """Return c and tan phi with their 95 % intervals, or why there are none."""
    found = parameters["after"] or parameters["before"]
    why: str = parameters["why"]
    if found is None:
        return f"{why[0].upper()}{why[1:]}."
    ends = [
        (
            scale * (found[name] - NORMAL_95 * found[sd]),
            scale * (found[name] + NORMAL_95 * found[sd]),
        )
        for name, sd, scale in (
            ("cohesion_pa", "cohesion_sd_pa", 1e-3),
            ("tan_phi", "tan_phi_sd", 1.0),
        )
    ]
    (low_c, high_c), (low_t, high_t) = ends
    return (
        f"c {1e-3 * found['cohesion_pa']:.3g} kPa ({max(low_c, 0.0):.3g} to {high_c:.3g}), tan phi"
        f" {found['tan_phi']:.3g} ({max(low_t, 0.0):.3g} to {high_t:.3g}), 95 % intervals."
    )


def wheel_sentence(outcome: WheelFinding, bed: Rig, cells: Cells) -> str:
    """Return the verdict in words."""
    judgement = outcome.judgement
    labels = ", ".join(each.label for each in judgement.named)
    words = {
        Verdict.NONE: (
            "no effect is identified: the most probable answer is that nothing is missing"
            f" ({judgement.probabilities['none']:.0%})"
        ),
        Verdict.NAMED: f"named: {labels}",
        Verdict.CONFUSABLE: f"confusable: {labels}. To separate: {outcome.separate_by}",
        Verdict.UNKNOWN: (
            f"unknown (closest: {labels}; what is left depends most on {outcome.left[1]} in the"
            f" {outcome.left[0]} row)"
        ),
    }[judgement.verdict]
    before, after = outcome.held_out.rms(bed.repeatability)
    if not outcome.held_out.described:
        words = f"{undescribed(before if after is None else after)}; {words}"
    proven = {None: "too few settings to prove it", True: "proven", False: "not proven"}[
        outcome.proven
    ]
    gap = (
        ""
        if after is None
        else (
            f"; held-out error from {before:.2f} to {after:.2f} deviations of repeatability,"
            f" {proven}"
        )
    )
    return f"{words}{gap}. {_strength_words(_parameters(outcome, cells))}"
