# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects that are tried only where all others leave the answer unknown.

They make a search slow, so that they are no candidates beside the others. Where the others end in
"unknown", each competes with a discrepancy and with what the others explain, and is the answer only
if held-out runs prove it.
"""

import dataclasses
from collections.abc import Sequence

from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Thresholds, Verdict
from terrain_estimator.discovery.hypotheses.contributions import Contributions
from terrain_estimator.discovery.hypotheses.library import ON_REQUEST, singles
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.proof.soil_proof import Proven, proven
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.report.investigation import investigate_as_told
from terrain_estimator.discovery.runs import Blocks


def or_on_request(
    finding: Finding,
    outcome: Proven,
    study: Study,
    thresholds: Thresholds,
    progress: ProgressCallback,
    runs: Sequence[Blocks],
    seed: int = 0,
    contributions: Contributions | None = None,
) -> tuple[Finding, Proven]:
    """Return the finding and outcome, or those of an effect ON_REQUEST that explains the runs.

    ``outcome`` is that of ``finding`` on the held-out ``runs``; without any, or with an answer,
    nothing more is tried. ``study`` is on the soils as told.
    """
    if not runs or outcome.finding.judgement.verdict is not Verdict.UNKNOWN:
        return finding, outcome
    hypotheses = singles(tuple(sorted(ON_REQUEST)), study.nominal.rover.axles)
    soil = finding.soil
    explained = soil.gain(finding.answer, study) if soil else finding.gains.explainable
    told = investigate_as_told(study, hypotheses, thresholds, progress, explained)
    before = outcome.finding.judgement.probabilities
    if told.judgement.verdict is Verdict.NAMED:
        told = _with_chances(told, dict.fromkeys(before, 0.0) | told.judgement.probabilities)
        again = proven(told, study, runs, seed, contributions)
        if again.proof is not None and again.proof.added:
            return told, again
    tried = dict.fromkeys((name for each in hypotheses for name in each.names), 0.0)
    settled = _with_chances(outcome.finding, tried | before)
    return finding, dataclasses.replace(outcome, finding=settled)


def _with_chances(finding: Finding, chances: dict[str, float]) -> Finding:
    judgement = dataclasses.replace(finding.judgement, probabilities=chances)
    return dataclasses.replace(finding, judgement=judgement)
