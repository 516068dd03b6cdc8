# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One hidden case, from sealed bags to the record of its verdict.

What counts as right:

- nothing hidden: "none";
- an effect at the size that matters: its name, or a confusable set with it; so for two at once;
- an effect at a third or a tenth of that size: the same, or "none": it does not ruin the estimate.
  "Unknown" is not right;
- an effect that the library lacks: "unknown";
- where the soil is told wrongly and nothing else is hidden: "none" or "soil", the soil's constants
  differ. With an effect hidden, too, the name of the effect is right;
- where the rover's constants are off within their stated deviations: the same as without. A payload
  or an odometry_scale that a stated deviation covers may also be "none" (or "soil");
- where the mass or the wheel radius is beyond its stated deviation: "payload" or "odometry_scale",
  or a set with it, with a 95 % interval of the size that holds the true one.

Where every observation of the analysed drives is refused, the command says so and has no verdict.
Such a case counts as wrong, too: "no drive".
"""

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from terrain_estimator.discovery.answer import (
    Answer,
    Question,
    answered,
    answered_with_ordinary_doubt,
)
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Verdict
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.hypotheses.rover_doubt import rover_doubt
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.offline.reading_runs import read_run_of
from terramechanics.presets import load_rover, load_soil, soil_names
from terramechanics.vehicle.rover import Rover
from tests.hidden.cases import Case, Plan, Truth, draw_cases
from tests.hidden.constants import Constants, is_covered, missing_size
from tests.hidden.judge.strata import Batch
from tests.hidden.sealing import seal

Record = dict[str, Any]
ROVER = "mars_rover"


def examine(batch: Batch) -> list[Record]:
    """Draw some cases, seal each, run the workflow on its bags, and judge the answer."""
    torch.set_num_threads(1)
    cases = draw_cases(batch.plan, batch.count, batch.seed, ROVER, batch.first)
    return [
        _examined(case, None if batch.untold else batch.plan.stated)
        | {"key": key, "family": batch.family}
        for key, case in zip(batch.keys, cases, strict=True)
    ]


def _examined(case: Case, stated: Constants | None) -> Record:
    with tempfile.TemporaryDirectory() as folder, torch.inference_mode():
        told = case.truth.plan.told or case.truth.soil
        answer = investigated(seal(case, Path(folder) / "bags"), told, case.rover, stated)
    return judged(case, *answer) if answer else without_drive(case)


def investigated(
    bags: list[Path], soil: str, rover: Rover | None = None, stated: Constants | None = ()
) -> tuple[Answer, tuple[int, ...]] | None:
    """Investigate these bags like the command, the last held out; no pages are written.

    ``stated`` are deviations of the rover's constants; None: nobody states any. Returns the answer
    and the numbers of the drives that were looked into; None where no drive but the last has an
    observation that is taken.
    """
    car = rover or load_rover(ROVER)
    nominal = nominal_of(car, load_soil(soil))
    told = replace(nominal, doubt=rover_doubt(car, dict(stated or ())))
    found = [read_run_of(told, bag).blocks for bag in bags[:-1]]
    studied = tuple(number for number, blocks in enumerate(found) if isinstance(blocks, Blocks))
    if not studied:
        return None
    kept = read_run_of(told, bags[-1], held_out=True).blocks
    study = Study(told, [blocks for blocks in found if isinstance(blocks, Blocks)])
    question = Question(
        singles(), list(map(load_soil, soil_names())), [kept] if isinstance(kept, Blocks) else []
    )
    if stated is None:
        return answered_with_ordinary_doubt(study, question, _silent)[0], studied
    return answered(study, question, _silent), studied


def _silent(_share: float, _label: str) -> None:
    pass


def outcome_of(finding: Finding, truth: tuple[str, ...]) -> str:
    """Return the outcome: exact, set, part (one of two), wrong name, unknown or none."""
    judgement = finding.judgement
    if judgement.verdict not in (Verdict.NAMED, Verdict.CONFUSABLE):
        return str(judgement.verdict)
    names, hidden = {tuple(sorted(each.names)) for each in judgement.named}, tuple(sorted(truth))
    if hidden in names:
        return "exact" if len(names) == 1 else "set"
    part = len(hidden) > 1 and all(set(each) <= set(hidden) for each in names)
    return "part" if part else "wrong name"


def right(outcome: str, plan: Plan, sizes: Sequence[float] = (), *, holds: bool = True) -> bool:
    """Return whether an outcome is right.

    ``sizes`` are those of the plan's parts in the units of the named laws. ``holds`` says whether
    the 95 % interval of the right name, where there is one, holds the true size.
    """
    nothing = outcome == "none" or (bool(plan.told) and outcome == "soil")
    if plan.beyond:
        return outcome in ("exact", "set") and holds
    if not plan.parts:
        return nothing
    if _is_covered(plan, sizes) and nothing:
        return True
    if plan.names == ("unknown",):
        return outcome == "unknown"
    small = max(1.0 if share is None else share for _, share in plan.parts) < 1.0
    return outcome in ("exact", "set") or (small and outcome == "none")


def _is_covered(plan: Plan, sizes: Sequence[float]) -> bool:
    """Return whether the stated deviations of the rover's constants cover what is hidden."""
    if plan.file is None or not plan.stated:
        return False
    every = zip(plan.parts, sizes, strict=True)
    return all(is_covered(name, size, plan.file, dict(plan.stated)) for (name, _), size in every)


def _missing(plan: Plan) -> float | None:
    """Return the size of the effect that a constant beyond its deviation is; None for none."""
    if not plan.beyond or plan.file is None:
        return None
    return missing_size(plan.file, dict(plan.off), plan.beyond)


def _holds(finding: Finding, plan: Plan) -> bool:
    """Return whether the interval of the right name holds the size of what is missing."""
    size = _missing(plan)
    if size is None:
        return True
    for each in finding.judgement.named:
        if each.names == plan.names:
            (_, found, sd) = finding.candidate(each).sizes[0]
            return abs(found - size) <= HALF_WIDTH_95 * sd
    return False


def judged(case: Case, answer: Answer, studied: tuple[int, ...]) -> Record:
    """Return the record of a case, of which the ``studied`` drives were looked into."""
    truth, finding = case.truth, answer.outcome.finding
    outcome = outcome_of(finding, truth.plan.names)
    holds = _holds(finding, truth.plan)
    gap = answer.outcome.proof.gap if answer.outcome.proof else None
    return (
        _conditions(truth)
        | {
            "outcome": outcome,
            "right": right(outcome, truth.plan, truth.equivalents, holds=holds),
            "before_proof": outcome_of(answer.found, truth.plan.names),
            "named": [each.label for each in finding.judgement.named],
            "soil_revised": finding.soil is not None,
            "soil_of_file": finding.soil.of_files if finding.soil else None,
            "soil_found": [each.found.name for each in finding.soil.revisions]
            if finding.soil
            else [],
            "share": finding.gains.share,
            "explainable": finding.gains.explainable,
            "with_discrepancy": [finding.gains.nothing_with, finding.gains.best_with],
            "gains": [(each.label, gain) for each, gain in finding.gains.named],
            "sizes": finding.best.sizes,
            "gap_closed": gap.closed if gap else None,
            "strength": _strength(finding, truth, studied),
        }
        | _constants_found(finding)
    )


def _constants_found(finding: Finding) -> Record:
    """Return how far the fit moved the rover's constants, in deviations; empty where none may."""
    found = finding.constants
    return {"moved": {each.name: [each.moved, each.moved_sd] for each in found}} if found else {}


NO_DRIVE = "no drive"


def without_drive(case: Case) -> Record:
    """Return the record of a case of which no drive can be used."""
    return _conditions(case.truth) | {"outcome": NO_DRIVE, "right": False, "gap_closed": None}


def _conditions(truth: Truth) -> Record:
    return {
        "plan": "+".join(name for name, _ in truth.plan.parts) or truth.plan.beyond or "none",
        "soil": truth.soil,
        "told": truth.plan.told or truth.soil,
        "rover": truth.plan.rover or ROVER,
        "noise": truth.plan.noise,
        "terrain": truth.terrain,
        "equivalents": truth.equivalents,
    } | _constants_told(truth.plan)


def _constants_told(plan: Plan) -> Record:
    if not plan.stated:
        return {}
    missing = _missing(plan)
    return {"stated": dict(plan.stated), "off": dict(plan.off), "missing": missing}


def _strength(finding: Finding, truth: Truth, studied: tuple[int, ...]) -> list[list[float]]:
    """Return the mean error of c [kPa] and tan phi, without and with the finding."""
    true = torch.tensor(
        [[truth.cohesion_pa[k] / 1000.0, truth.tan_phi[k]] for k in studied], dtype=torch.float64
    )
    fits = (finding.nothing.fit, finding.best.fit)
    return [
        (torch.stack([run.theta for run in fit.point.runs]) - true).mean(0).tolist() for fit in fits
    ]
