# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Content of finding.json about one wheel on a testbed, and the verdict in words."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from terrain_estimator.discovery.evidence.verdict import Verdict
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.single_wheel.cells import (
    ROWS,
    UNITS,
    Cells,
    Rig,
    Row,
    cells_of,
)
from terrain_estimator.discovery.single_wheel.free_law import UNITS_OF_CONSTANTS
from terrain_estimator.discovery.single_wheel.investigation import FLOOR, HeldOut, WheelFinding
from terrain_estimator.discovery.single_wheel.law_fits import (
    ConstantsMeasured,
    LawFits,
)
from terrain_estimator.discovery.single_wheel.size import change
from terrain_estimator.observation import Floats
from terrain_estimator.offline.effect_entries import change_entry, effect_entries, interval_entry
from terrain_estimator.pages.wheel_finding import undescribed

NOT_IDENTIFIED = (
    "c and tan phi are not identified: these tables have no drive torque, so both were left free"
    " and are not reported"
)
UNRELIABLE = (
    "c and tan phi are not reported: the sampler did not resolve them; state smaller deviations of"
    " the soil constants"
)
REPLICATES = "replicates of one setting count as one measurement"


@dataclass(frozen=True, slots=True)
class Measured:
    """A value and its standard deviation."""

    value: float
    sd: float


@dataclass(frozen=True, slots=True)
class ShearBox:
    """c and tan phi as another instrument measured them."""

    cohesion_pa: Measured
    tan_phi: Measured


def wheel_content(
    outcome: WheelFinding,
    fits: LawFits,
    bed: Rig,
    rows: Sequence[Row],
    reference: frozenset[str],
    given: Hypothesis,
    tables: Sequence[Path],
    box: ShearBox | None = None,
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
            entry
            for hypothesis in judgement.named
            for entry in _effects(outcome, hypothesis, cells, given, seed)
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
        "fits": _fits(fits, box),
        "runs": [path.name for path in tables],
        "held_out": ["each trial in turn" if by_trial else f"each of {tried} settings in turn"],
        "rows": [name for name, seen in zip(ROWS, cells.seen.any(0).tolist(), strict=True) if seen],
        "settings": len(cells.slip),
        "measurements": len(rows),
        "given": list(given.names),
        "limits": [*filter(None, [_why(fits.measured)]), REPLICATES],
    }


def _fits(fits: LawFits, box: ShearBox | None) -> dict[str, Any]:
    """Return both fits of the contact law."""
    units = dict(zip(ROWS, UNITS, strict=True))
    rows = {name: {"rms": rms, "unit": units[name]} for name, rms in fits.free.rms.items()}
    return {
        "effects": list(fits.effects),
        "constants_free": {
            "rows": rows,
            "unknowns": fits.free.unknowns,
            "measurements": fits.free.measurements,
        },
        "constants_as_measured": _as_measured(fits),
        "why": _why(fits.measured),
        "shear_box": None if box is None else dataclasses.asdict(box),
    }


def _why(found: ConstantsMeasured | None) -> str:
    """Return why c and tan phi are not reported; empty where they are."""
    if found is None:
        return NOT_IDENTIFIED
    return "" if found.reliable else UNRELIABLE


def _as_measured(fits: LawFits) -> dict[str, Any] | None:
    found = fits.measured
    if found is None or not found.reliable:
        return None
    units = dict(zip(ROWS, UNITS, strict=True))
    errors = {
        name: interval_entry(each) | {"unit": units[name]}
        for name, each in found.model_error.items()
    }
    return {
        "cohesion_pa": interval_entry(found.cohesion_pa),
        "tan_phi": interval_entry(found.tan_phi),
        "model_error": errors,
        "rejected": [
            {
                "name": each.name,
                "unit": UNITS_OF_CONSTANTS[each.name],
                "measured": each.measured,
                "measured_sd": each.measured_sd,
                "fitted": interval_entry(each.fitted),
                "deviations": each.deviations,
            }
            for each in fits.rejected
        ],
        "effective_draws": found.effective,
    }


def _effects(
    outcome: WheelFinding, hypothesis: Hypothesis, cells: Cells, given: Hypothesis, seed: int
) -> list[dict[str, Any]]:
    """Return the effects of a hypothesis: changes by all laws, sizes by the registry's.

    A pair has one law of each effect, the most probable one, which need not be the registry's.
    """
    family = outcome.family(hypothesis)
    registry = (
        each
        for each in family.laws
        if all(effect.competing is None for effect in each.hypothesis.effects)
    )
    own = next(registry, family.laws[0])
    probability = outcome.judgement.probabilities.get(" + ".join(hypothesis.names), 0.0)
    factor = outcome.weighed.gain(family, {})
    changed = change_entry(change(outcome.bed, cells, given, family, seed))
    laws = [
        {"law": " + ".join(each.law_name for each in law.hypothesis.effects), "weight": weight}
        for law, weight in zip(family.laws, family.weights, strict=True)
    ]
    return [
        entry | {"change": changed, "laws": laws}
        for entry in effect_entries(own.hypothesis, own.sizes(outcome.first), probability, factor)
    ]


def _gap(outcome: WheelFinding, bed: Rig, seed: int) -> dict[str, Any]:
    """Return the gap on held-out settings: in deviations of measurement, and by row in units."""
    errors = outcome.held_out
    before, after = errors.rms(bed.deviations)
    interval = errors.improvement_95(bed.deviations, seed)
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
        "points": _points(errors),
    }


def _points(errors: HeldOut) -> dict[str, Any]:
    """Return measured and predicted values of every held-out setting, by row."""
    rows = {}
    for k, (name, unit) in enumerate(zip(ROWS, UNITS, strict=True)):
        measured = errors.measured[:, k]
        if np.isnan(measured).all():
            continue
        after = None if errors.after is None else _listed(measured - errors.after[:, k])
        rows[name] = {
            "unit": unit,
            "measured": _listed(measured),
            "before": _listed(measured - errors.before[:, k]),
            "after": after,
        }
    return {"slip": errors.slip.tolist(), "load_n": errors.load.tolist(), "rows": rows}


def _listed(values: Floats) -> list[float | None]:
    """Return values for JSON, None where there is none."""
    return [float(each) if np.isfinite(each) else None for each in values]


def _gap_by_row(errors: HeldOut, bed: Rig) -> dict[str, dict[str, Any]]:
    rows = {}
    for k, (name, unit) in enumerate(zip(ROWS, UNITS, strict=True)):
        seen = ~np.isnan(errors.before[:, k])
        if seen.any():
            rows[name] = {
                "before": _rms(errors.before[seen, k]),
                "after": None if errors.after is None else _rms(errors.after[seen, k]),
                "noise_floor": bed.deviations[k],
                "unit": unit,
            }
    return rows


def _rms(errors: Floats) -> float:
    return float((errors**2).mean() ** 0.5)


def wheel_sentence(outcome: WheelFinding, bed: Rig) -> str:
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
    before, after = outcome.held_out.rms(bed.deviations)
    if not outcome.held_out.described:
        words = f"{undescribed(before if after is None else after)}; {words}"
    proven = {None: "too few settings to prove it", True: "proven", False: "not proven"}[
        outcome.proven
    ]
    gap = (
        ""
        if after is None
        else (
            f"; held-out error from {before:.2f} to {after:.2f} deviations of measurement, {proven}"
        )
    )
    return f"{words}{gap}."
