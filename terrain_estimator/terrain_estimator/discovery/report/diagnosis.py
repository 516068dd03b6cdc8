# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Beside a verdict: where the model disagrees, what the runs separate, what to drive next."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from terrain_estimator.discovery.evidence.isolability import Isolability, isolability
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict, read_thresholds
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.locate.where import RowDisagreement, disagreements
from terrain_estimator.discovery.next_drive.missing_signals import MissingSignal, missing_signals
from terrain_estimator.discovery.next_drive.next_drive import MOST, NextDrive, advise, next_drives
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.report.finding import Finding


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The results beside a Finding."""

    where: tuple[RowDisagreement, ...]
    isolability: Isolability
    next_drives: tuple[NextDrive, ...]  # the best first; empty where nothing is in doubt
    missing_signals: tuple[MissingSignal, ...] = ()  # likewise

    def separate_by(self, judgement: Judgement) -> str:
        """Return advice on separating confusable effects; empty where nothing is confusable."""
        if judgement.verdict is not Verdict.CONFUSABLE:
            return ""
        names = [name for each in judgement.named for name in each.names]
        return advise(names, self.next_drives, self.missing_signals)

    def plain(self) -> dict[str, Any]:
        """Return its parts of finding.json."""
        nats = [[round(each, 1) for each in row] for row in self.isolability.nats.tolist()]
        return {
            "where": [dataclasses.asdict(each) for each in self.where],
            "isolability": {
                "names": list(self.isolability.names),
                "nats": nats,
                "not_testable": self.isolability.not_testable,
            },
            "next_drives": [dataclasses.asdict(each) for each in self.next_drives],
            "missing_signals": [dataclasses.asdict(each) for each in self.missing_signals],
        }


def diagnose(
    study: Study, hypotheses: Sequence[Hypothesis], finding: Finding, progress: ProgressCallback
) -> Diagnosis:
    """Look at the runs of ``study``, on the soils as told, after the verdict."""
    progress(0.95, "where it disagrees")
    found = tuple(disagreements(study))
    progress(0.96, "what these runs can tell apart")
    there = finding.study(study)
    clear = finding.judgement.verdict in (Verdict.NONE, Verdict.SOIL)
    around = there.nothing if clear else finding.best
    apart = isolability(there, hypotheses, around)
    progress(0.97, "what to drive next")
    if study.nominal.places is not None:  # no manoeuvre of a rover that turns is simulated
        return Diagnosis(found, apart, ())
    doubtful = in_doubt(finding, hypotheses, apart)[:MOST]
    return Diagnosis(
        found,
        apart,
        tuple(next_drives(there, doubtful, around)),
        tuple(missing_signals(there, doubtful, around, read_thresholds().apart)),
    )


def in_doubt(
    finding: Finding, hypotheses: Sequence[Hypothesis], apart: Isolability
) -> list[Hypothesis]:
    """Return the effects between which a next drive should decide.

    Those that are confusable; a named effect and the one that it would be mistaken for; the two
    closest where it is unknown.
    """
    judgement = finding.judgement
    close = judgement.named
    if judgement.verdict is Verdict.UNKNOWN:
        close = tuple(each.hypothesis for each in finding.candidates[:2])
    elif judgement.verdict is Verdict.NAMED:
        nearest = apart.nearest(judgement.named[0].label)
        close += tuple(each for each in hypotheses if each.label == nearest)
    shared = set.intersection(*(set(each.effects) for each in close)) if len(close) > 1 else set()
    alone = [tuple(effect for effect in each.effects if effect not in shared) for each in close]
    return [Hypothesis(effects) for effects in dict.fromkeys(alone) if len(effects) == 1]
