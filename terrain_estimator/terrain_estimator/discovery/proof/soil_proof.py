# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The proof of revised soil constants on held-out runs, and of a whole finding."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from terrain_estimator.discovery.evidence.soil_revision import RevisedStudy
from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict
from terrain_estimator.discovery.hypotheses.contributions import Contributions, here
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.proof.proof import (
    Proof,
    evidences,
    models_of,
    prove,
    settled,
)
from terrain_estimator.discovery.proof.rule import LIKELIER
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.runs import Blocks


@dataclass(frozen=True, slots=True)
class SoilProof:
    """The result of the held-out runs for the soils as told and for the revised ones."""

    before: float  # [1] rms error of rollouts on the soils as told, in sd of the sensors
    after: float  # [1] on the revised soils, without an effect
    noise_floor: float  # [1] of the latter
    log_bayes_factor: float  # [nat] of the runs as a whole, revised over told

    @property
    def holds(self) -> bool:
        """Whether the held-out runs are LIKELIER on the revised soils."""
        return self.log_bayes_factor >= LIKELIER

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        outcome = "hold" if self.holds else "do not hold"
        return (
            f"the revised soils {outcome} on held-out runs: rollouts miss by"
            f" {self.after:.2f} instead of {self.before:.2f} sd of the sensors, the noise floor is"
            f" {self.noise_floor:.2f}; the runs as a whole are {self.log_bayes_factor:.0f} nat"
            " likelier"
        )


def prove_soil(
    told: Nominal,
    study: Study,
    candidate: Candidate | None,
    runs: Sequence[Blocks],
    proof: Proof,
    nothing: Candidate,
    seed: int = 0,
    contributions: Contributions | None = None,
) -> SoilProof:
    """Compare the soils of ``study`` with those as told on held-out ``runs``.

    ``candidate`` is the named effect, which both have; ``proof`` is that of ``study``. ``nothing``
    is the fit of "nothing is missing" on the soils as told, see :func:`prove`.
    """
    each_run = contributions or here(runs)
    likelier = [
        _log_evidence(nominal, candidate or none, runs, each_run)
        for nominal, none in ((told, nothing), (study.nominal, study.nothing))
    ]
    before = prove(told, None, runs, seed, contributions, nothing).gap
    after = proof.gap
    assert before is not None
    assert after is not None  # no soil is revised for rovers that turn
    return SoilProof(before.before, after.before, after.noise_floor, likelier[1] - likelier[0])


def _log_evidence(
    nominal: Nominal, candidate: Candidate, runs: Sequence[Blocks], each_run: Contributions
) -> float:
    """Return the log evidence [nat] of runs with a candidate."""
    models = models_of(candidate)[-1:]
    found = each_run(partial(_evidences, nominal=nominal), [models] * len(runs))
    return sum(each[0] for each in found)


def _evidences(run: Blocks, models: tuple, *, nominal: Nominal) -> list[float]:  # type: ignore[type-arg]
    return evidences(nominal, models, run)


@dataclass(frozen=True, slots=True)
class Proven:
    """A finding with the held-out runs counted."""

    finding: Finding
    proof: Proof | None = None  # None where no run is held out
    # of the revised soils; None where there are none, or no held-out run is on a revised one
    soil: SoilProof | None = None
    # revised soils that held-out runs refute, where the finding is one on the soils as told
    refuted: RevisedStudy | None = None

    @property
    def unproven(self) -> str:
        """Why a name that stands is unproven; empty where it is proven or none stands."""
        if self.proof is None:
            return "no run was held out"
        return "the held-out runs hardly show it" if self.proof.undecided else ""

    @property
    def soil_refuted(self) -> bool:
        """Whether held-out runs contradict the revised constants."""
        return self.soil is not None and not self.soil.holds

    @property
    def soil_sentence(self) -> str:
        """The outcome for revised constants in words; empty where there are none."""
        if self.soil is not None:
            return self.soil.sentence
        if self.finding.soil is None or self.proof is None:
            return ""
        names = " or ".join(each.told.name for each in self.finding.soil.revisions)
        return f"no held-out run is on soil {names}: the revised soil is unproven"


def proven(
    finding: Finding,
    study: Study,
    runs: Sequence[Blocks],
    seed: int = 0,
    contributions: Contributions | None = None,
) -> Proven:
    """Prove the best name, and the soils where they are revised, on held-out ``runs``.

    The nominal model alone is scored where no effect is named. ``study`` is on the soils as told.

    Raises:
        RunError: a run is too short.
    """
    if not runs:
        return Proven(finding)
    best, there = _named(finding), finding.study(study)
    nothing = there.without(best) if best else finding.nothing
    proof = prove(there.nominal, best, runs, seed, contributions, nothing)
    after = settled(finding, proof)
    if finding.soil is None:
        return Proven(after, proof)
    if {run.soil or study.nominal.soil for run in runs}.isdisjoint(
        each.told for each in finding.soil.revisions
    ):
        return Proven(after, proof)
    asked = runs, proof, study.nothing, seed, contributions
    soil = prove_soil(study.nominal, there, best, *asked)
    if soil.holds:
        return Proven(after, proof, soil)
    return Proven(_refuted(after), replace(proof, undecided=False), soil)


def proven_or_told(
    finding: Finding,
    study: Study,
    as_told: Callable[[float], Finding],
    runs: Sequence[Blocks],
    seed: int = 0,
    contributions: Contributions | None = None,
) -> tuple[Finding, Proven]:
    """Prove a finding or, where held-out runs refute its soils, the one on the soils as told.

    ``as_told`` returns that one for what the refuted soils explain [nat]. It is the answer where it
    has a name that proves itself, and with which the held-out runs are likelier than on the refuted
    soils with theirs. Returns the finding that was proven and the outcome, see :func:`proven`.
    """
    outcome = proven(finding, study, runs, seed, contributions)
    if finding.soil is None or not outcome.soil_refuted:
        return finding, outcome
    told = as_told(finding.soil.gain(finding.answer, study))
    again = proven(told, study, runs, seed, contributions)
    if again.proof is None or not again.proof.added:
        return finding, outcome
    each_run = contributions or here(runs)
    before, after = (
        _log_evidence(found.study(study).nominal, _named(found) or found.nothing, runs, each_run)
        for found in (finding, told)
    )
    if after <= before:
        return finding, outcome
    return told, replace(again, soil=outcome.soil, refuted=finding.soil)


def _named(finding: Finding) -> Candidate | None:
    """Return the best name of a finding; None where it names nothing."""
    named = finding.judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
    return finding.best if named else None


def _refuted(finding: Finding) -> Finding:
    """Return the finding where held-out runs refute the revised constants: unknown."""
    chances = dict.fromkeys(finding.judgement.probabilities, 0.0) | {"unknown": 1.0}
    judgement = Judgement(Verdict.UNKNOWN, finding.judgement.named[:1], chances)
    return replace(finding, judgement=judgement)
