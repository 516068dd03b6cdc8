# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What goes with a verdict: where the model disagrees, which effects these runs can tell apart, and what to drive next."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from terrain_estimator.discovery.finding import Finding
from terrain_estimator.discovery.isolability import Isolability, isolability
from terrain_estimator.discovery.library import Hypothesis
from terrain_estimator.discovery.search import Progress, Study
from terrain_estimator.discovery.verdict import Verdict
from terrain_estimator.discovery.where import Disagreement, disagreements


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Beside a Finding."""

    where: tuple[Disagreement, ...]
    isolability: Isolability

    def plain(self) -> dict[str, Any]:
        """As parts of finding.json."""
        nats = [[round(each, 1) for each in row] for row in self.isolability.nats.tolist()]
        return {
            "where": [asdict(each) for each in self.where],
            "isolability": {"names": list(self.isolability.names), "nats": nats, "not_testable": self.isolability.not_testable},
            "next_drives": [],
        }


def diagnose(study: Study, hypotheses: Sequence[Hypothesis], finding: Finding, say: Progress) -> Diagnosis:
    """Look at the runs of ``study`` after the verdict."""
    say(0.95, "where it disagrees")
    found = tuple(disagreements(study))
    say(0.97, "what these runs can tell apart")
    around = study.nothing if finding.judgement.verdict is Verdict.NONE else finding.best
    return Diagnosis(found, isolability(study, hypotheses, around))
