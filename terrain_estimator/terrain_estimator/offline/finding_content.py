# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Content of finding.json about drives, and the verdict in words."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict
from terrain_estimator.discovery.hypotheses.library import ON_REQUEST, Hypothesis
from terrain_estimator.discovery.hypotheses.rover_doubt import STANDS_FOR
from terrain_estimator.discovery.proof.gap import Gap
from terrain_estimator.discovery.proof.soil_proof import Proven
from terrain_estimator.discovery.report.diagnosis import Diagnosis
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.report.wheel_changes import wheel_changes
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.offline.effect_entries import change_entry, effect_entries
from terrain_estimator.offline.revised_soils import refuted_content, soils_content
from terrain_estimator.pages.finding_words import (
    constant_words,
    doubt_note,
    exact_words,
    ground_words,
    not_tried_words,
    soil_words,
    unseen_words,
)
from terramechanics.effects import describe


def finding_content(
    outcome: Proven,
    diagnosis: Diagnosis,
    study: Study,
    unseen: Sequence[Blocks],
    seed: int = 0,
) -> dict[str, Any]:
    """Return the content of finding.json; ``study`` is on the soils as told."""
    finding, proof = outcome.finding, outcome.proof
    judgement = finding.judgement
    after = judgement.named[0] if judgement.named else None
    constants = [each.plain() for each in finding.constants]
    exact = exact_constants(finding)
    return {
        "verdict": str(judgement.verdict),
        "probabilities": judgement.probabilities,
        "effects": [
            entry
            for hypothesis in judgement.named
            for entry in _effects(finding, hypothesis, finding.study(study), seed)
        ],
        "confusable_with": [each.label for each in judgement.named[1:]],
        "not_tried": not_tried(judgement, diagnosis),
        "separate_by": diagnosis.separate_by(judgement),
        "left": [
            {
                "row": each.column.row,
                "signal": each.column.signal,
                "strength": math.sqrt(each.strength),
            }
            for each in finding.left[:3]
        ],
        **diagnosis.plain(),
        **({"rover_constants": constants} if constants else {}),
        **({"exact_constants": exact} if exact else {}),
        "soils": soils_content(outcome),
        "refuted_soils": refuted_content(outcome),
        "soil_proof": _soil_proof(outcome),
        "added": proof is not None and proof.added,
        **(
            proof.plain()
            if proof
            else {
                "gap": dict.fromkeys(item.name for item in dataclasses.fields(Gap)),
                "proof": None,
            }
        ),
        "parameters": {"before": _parameters(finding, None), "after": _parameters(finding, after)},
        "runs": [each.name for each in study.runs],
        "held_out": [each.name for each in unseen],
    }


def not_tried(judgement: Judgement, diagnosis: Diagnosis) -> list[str]:
    """Return the effects that only ``--library`` tries, where the verdict is unknown without."""
    if judgement.verdict is not Verdict.UNKNOWN:
        return []
    tried = {part for name in judgement.probabilities for part in name.split(" + ")}
    return sorted(ON_REQUEST - tried - set(diagnosis.isolability.not_testable))


def _soil_proof(outcome: Proven) -> dict[str, Any] | None:
    if not outcome.soil_sentence:
        return None
    numbers = dataclasses.asdict(outcome.soil) if outcome.soil else {}
    holds = outcome.soil.holds if outcome.soil else None
    return numbers | {"holds": holds, "sentence": outcome.soil_sentence}


def _effects(
    finding: Finding, hypothesis: Hypothesis, study: Study, seed: int
) -> list[dict[str, Any]]:
    """Return the entries of a hypothesis, with what an effect changes of one wheel."""
    candidate = finding.candidate(hypothesis)
    probability = finding.judgement.probabilities[" + ".join(hypothesis.names)]
    factor = candidate.fit.log_evidence - finding.nothing.fit.log_evidence
    changes = wheel_changes(candidate, study.nominal, study.runs, seed)
    entries = effect_entries(candidate.hypothesis, candidate.sizes, probability, factor)
    return [
        entry if change is None else entry | {"change": change_entry(change)}
        for entry, change in zip(entries, changes, strict=True)
    ]


def _parameters(finding: Finding, hypothesis: Hypothesis | None) -> dict[str, list[float]]:
    """Return c [Pa] and tan phi of every run."""
    fit = (finding.candidate(hypothesis) if hypothesis else finding.nothing).fit
    return {
        "cohesion_pa": [1000.0 * float(run.theta[0]) for run in fit.point.runs],
        "tan_phi": [float(run.theta[1]) for run in fit.point.runs],
    }


def exact_constants(finding: Finding) -> list[str]:
    """Return the constants of the rover that count as exact and have a named effect beside them."""
    named = {name for hypothesis in finding.judgement.named for name in hypothesis.names}
    doubted = {each.name for each in finding.constants}
    found = (constant for effect, constant in STANDS_FOR.items() if effect in named)
    return [each for each in found if each not in doubted]


def finding_sentence(outcome: Proven, diagnosis: Diagnosis) -> str:
    """Return the verdict in words, and the result on the held-out runs."""
    unproven = "no run is held out: the finding is unproven, give a third run or --hold-out"
    lines = [
        _verdict(outcome, diagnosis),
        not_tried_words(not_tried(outcome.finding.judgement, diagnosis)),
        *map(soil_words, [*soils_content(outcome), *refuted_content(outcome)]),
        *(constant_words(each.plain()) for each in outcome.finding.constants),
        exact_words(exact_constants(outcome.finding)),
        outcome.proof.sentence if outcome.proof else unproven,
        outcome.soil_sentence,
    ]
    return "\n".join(filter(None, lines))


def _verdict(outcome: Proven, diagnosis: Diagnosis) -> str:
    finding, proof = outcome.finding, outcome.proof
    judgement = finding.judgement
    if judgement.verdict is Verdict.UNKNOWN and not judgement.named and proof and proof.gap:
        return unseen_words(proof.gap.before, proof.gap.noise_floor)
    labels = [each.label for each in judgement.named]
    sizes = ", ".join(
        f"{name} {size:.4g} +- {sd:.2g} {describe(name).unit}"
        for name, size, sd in finding.best.sizes
    )
    left = finding.left[0].column if finding.left else None
    ground = ground_words(soils_content(outcome), len(finding.nothing.fit.point.runs))
    constants = "the soil constants differ from those of the soil file"
    answers = {
        "none": "no missing effect shows in these runs",
        "soil": f"{ground or constants}; nothing else is missing",
        "named": f"named: {sizes}",
        "confusable": (
            f"confusable: {', '.join(labels)}. To separate: {diagnosis.separate_by(judgement)}"
        ),
        "unknown": (
            f"unknown: no named effect explains it (closest: {', '.join(labels)})"
            + (f"; the {left.row} row depends on {left.signal}" if left else "")
        ),
    }
    return answers[judgement.verdict] + doubt_note(judgement.verdict, judgement.probabilities)
