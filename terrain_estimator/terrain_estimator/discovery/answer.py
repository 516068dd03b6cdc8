# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The whole answer about the runs of a study: search, proof, and a rover file that may be off."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Thresholds, read_thresholds
from terrain_estimator.discovery.hypotheses.contributions import Contributions
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.rover_doubt import ordinary_doubt
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.proof.on_request import or_on_request
from terrain_estimator.discovery.proof.soil_proof import Proven, proven_or_told
from terrain_estimator.discovery.report.finding import Finding, part_of
from terrain_estimator.discovery.report.investigation import (
    investigate,
    investigate_as_told,
    may_be_the_file,
)
from terrain_estimator.discovery.runs import Blocks
from terramechanics.terrain.soil import Soil


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked about the runs of a study."""

    hypotheses: Sequence[Hypothesis]  # effects that may be missing
    soils: Sequence[Soil]  # on which the runs may be instead of those told
    unseen: Sequence[Blocks]  # held-out runs; without any nothing is proven
    seed: int = 0  # of the proof
    contributions: Contributions | None = None  # of the held-out runs; None: computed here
    on_request: bool = True  # where all end unknown, effects ON_REQUEST are tried
    thresholds: Thresholds = field(default_factory=read_thresholds)


@dataclass(frozen=True, slots=True)
class Answer:
    """What was found."""

    study: Study
    found: Finding  # before the held-out runs were asked
    asked: Finding  # what they were asked about
    outcome: Proven

    def considered(self, question: Question) -> list[Hypothesis]:
        """Return the effects of the question, and those that were tried beside them."""
        known = self.study.doubting(question.hypotheses)
        tried = [each.hypothesis for each in self.asked.candidates]
        return [*known, *(each for each in tried if len(each.effects) == 1 and each not in known)]


def answered(study: Study, question: Question, progress: ProgressCallback) -> Answer:
    """Search what is missing, and ask the held-out runs about it.

    By wheel no other soil is weighed, and no effect is tried on request.
    """
    asked_of = study, question.hypotheses, question.thresholds
    searching, last = part_of(progress, 0.0, 0.9), part_of(progress, 0.9, 1.0)
    by_wheel = study.nominal.places is not None
    found = (
        investigate_as_told(*asked_of, searching, 0.0)
        if by_wheel
        else investigate(*asked_of, searching, question.soils)
    )
    progress(0.9, "held-out runs")
    kept = question.unseen, question.seed, question.contributions
    asked, outcome = proven_or_told(
        found, study, partial(investigate_as_told, *asked_of, last), *kept
    )
    if question.on_request and not by_wheel:
        asked, outcome = or_on_request(asked, outcome, study, question.thresholds, last, *kept)
    return Answer(study, found, asked, outcome)


def answered_with_ordinary_doubt(
    study: Study, question: Question, progress: ProgressCallback
) -> tuple[Answer, Answer | None]:
    """Answer where nobody states how far off the constants of the rover file may be.

    ``study`` counts them as exact. Where its answer may be no more than such files are usually off
    by, the runs are searched again with these constants in doubt. Returns the answer, and the one
    of the exact file where it was searched again. By wheel the file counts as exact.
    """
    exact = answered(study, question, progress)
    if study.nominal.places is not None:
        return exact, None
    usual = replace(study.nominal, doubt=ordinary_doubt(study.nominal.rover))
    doubted = partial(Study, usual, study.runs, contributions=study.contributions)
    proof = exact.outcome.proof
    unproven = proof is not None and proof.undecided
    again = may_be_the_file(exact.outcome.finding, doubted, question.thresholds, unproven=unproven)
    if again is None:
        return exact, None
    return answered(again, question, part_of(progress, 0.9, 1.0)), exact
