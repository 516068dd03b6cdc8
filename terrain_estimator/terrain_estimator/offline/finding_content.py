# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Content of finding.json about drives, and the verdict in words."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.proof.gap import Gap
from terrain_estimator.discovery.proof.proof import Proof
from terrain_estimator.discovery.report.diagnosis import Diagnosis
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.offline.effect_entries import effect_entries
from terrain_estimator.pages.finding_words import doubt_note
from terramechanics.effects import describe


def finding_content(
    finding: Finding,
    diagnosis: Diagnosis,
    blocks: Sequence[Blocks],
    unseen: Sequence[Blocks],
    proof: Proof | None,
) -> dict[str, Any]:
    """Return the content of finding.json."""
    judgement = finding.judgement
    after = judgement.named[0] if judgement.named else None
    return {
        "verdict": str(judgement.verdict),
        "probabilities": judgement.probabilities,
        "effects": [
            entry for hypothesis in judgement.named for entry in _effects(finding, hypothesis)
        ],
        "confusable_with": [each.label for each in judgement.named[1:]],
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
        "runs": [each.name for each in blocks],
        "held_out": [each.name for each in unseen],
    }


def _effects(finding: Finding, hypothesis: Hypothesis) -> list[dict[str, Any]]:
    candidate = finding.candidate(hypothesis)
    probability = finding.judgement.probabilities[" + ".join(hypothesis.names)]
    factor = candidate.fit.log_evidence - finding.nothing.fit.log_evidence
    return effect_entries(candidate.sizes, probability, factor)


def _parameters(finding: Finding, hypothesis: Hypothesis | None) -> dict[str, list[float]]:
    """Return c [Pa] and tan phi of every run."""
    fit = (finding.candidate(hypothesis) if hypothesis else finding.nothing).fit
    return {
        "cohesion_pa": [1000.0 * float(run.theta[0]) for run in fit.point.runs],
        "tan_phi": [float(run.theta[1]) for run in fit.point.runs],
    }


def finding_sentence(finding: Finding, diagnosis: Diagnosis, proof: Proof | None) -> str:
    """Return the verdict in words, and the result on the held-out runs."""
    unproven = "no run is held out: the finding is unproven, give a third run or --hold-out"
    return f"{_verdict(finding, diagnosis)}\n{proof.sentence if proof else unproven}"


def _verdict(finding: Finding, diagnosis: Diagnosis) -> str:
    judgement = finding.judgement
    labels = [each.label for each in judgement.named]
    sizes = ", ".join(
        f"{name} {size:.4g} +- {sd:.2g} {describe(name).unit}"
        for name, size, sd in finding.best.sizes
    )
    left = finding.left[0].column if finding.left else None
    words = {
        "none": "no missing effect shows in these runs",
        "named": f"named: {sizes}",
        "confusable": (
            f"confusable: {', '.join(labels)}. To separate: {diagnosis.separate_by(judgement)}"
        ),
        "unknown": (
            f"unknown: no named effect explains it (closest: {', '.join(labels)})"
            + (f"; the {left.row} row depends on {left.signal}" if left else "")
        ),
    }
    return words[judgement.verdict] + doubt_note(judgement.verdict, judgement.probabilities)
