# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects that are tried only where all others leave the answer unknown."""

from dataclasses import replace
from functools import cache

import torch

from studies.foreign.drives import observations_of
from studies.foreign.logs import measured_columns, read_log
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Verdict, read_thresholds
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.proof.on_request import or_on_request
from terrain_estimator.discovery.proof.soil_proof import Proven, proven
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.report.investigation import investigate_as_told
from terrain_estimator.discovery.runs import Blocks, Refusals, cut, run_of
from terramechanics.presets import load_rover, load_soil

SEEN, HELD_OUT = ("A_cruise_scm", "A_sines_scm"), "A_slopes_scm"
NOMINAL = nominal_of(load_rover("mars_rover"), load_soil("loose_sand"))


def silent(share: float, note: str) -> None:
    del share, note


def run(name: str, seconds: int) -> Blocks:
    log = read_log(name)
    observations = observations_of(measured_columns(log, 0), log.rover)[: 10 * seconds]
    found = run_of(name, observations, log.rover, CoreConfig(), Refusals())
    return cut(found, NOMINAL.contact)


@cache
def searched() -> tuple[Study, Finding, Proven, list[Blocks]]:
    """Return a search of foreign drives for an effect that they do not have."""
    unseen = [run(HELD_OUT, 20)]
    study = Study(NOMINAL, [run(name, 10) for name in SEEN])
    hypotheses = singles(("slope_bias",))
    finding = investigate_as_told(study, hypotheses, read_thresholds(), silent, 0.0)
    return study, finding, proven(finding, study, unseen), unseen


@torch.inference_mode()
def test_the_law_of_foreign_drives_is_named_where_all_else_leaves_the_answer_unknown() -> None:
    study, finding, outcome, unseen = searched()
    assert outcome.finding.judgement.verdict is Verdict.UNKNOWN
    _, found = or_on_request(finding, outcome, study, read_thresholds(), silent, unseen)
    judgement = found.finding.judgement
    assert judgement.verdict is Verdict.NAMED
    assert [each.label for each in judgement.named] == ["contact_law_scm"]
    assert found.proof is not None
    assert found.proof.added
    assert judgement.probabilities["slope_bias"] == 0.0


@torch.inference_mode()
def test_nothing_more_is_tried_where_there_is_an_answer_or_no_held_out_run() -> None:
    study, finding, outcome, unseen = searched()
    thresholds = read_thresholds()
    without = or_on_request(finding, outcome, study, thresholds, silent, [])
    assert without == (finding, outcome)
    for verdict in set(Verdict) - {Verdict.UNKNOWN}:
        judgement = replace(outcome.finding.judgement, verdict=verdict)
        answered = replace(outcome, finding=replace(outcome.finding, judgement=judgement))
        same = or_on_request(finding, answered, study, thresholds, silent, unseen)
        assert same == (finding, answered)
