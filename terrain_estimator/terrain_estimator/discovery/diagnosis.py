# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What goes with a verdict: where the model disagrees, which effects these runs can tell apart, and what to drive next."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from terrain_estimator.discovery.finding import Finding
from terrain_estimator.discovery.library import Hypothesis
from terrain_estimator.discovery.search import Progress, Study
from terrain_estimator.discovery.where import Disagreement, disagreements
from terramechanics.effects import EFFECTS


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Beside a Finding."""

    where: tuple[Disagreement, ...]

    def plain(self) -> dict[str, Any]:
        """As parts of finding.json."""
        sideways = {name: "it acts sideways, which a planar rover does not show" for name, each in EFFECTS.items() if each.make is None}
        return {
            "where": [asdict(each) for each in self.where],
            "isolability": {"names": [], "nats": [], "not_testable": sideways},
            "next_drives": [],
        }


def diagnose(study: Study, hypotheses: Sequence[Hypothesis], finding: Finding, say: Progress) -> Diagnosis:
    """Look at the runs of ``study`` after the verdict."""
    del hypotheses, finding
    say(0.95, "where it disagrees")
    return Diagnosis(tuple(disagreements(study)))
