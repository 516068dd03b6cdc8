# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What find_missing_effect --wheel-table says of one drawn laboratory."""

from dataclasses import dataclass

import numpy as np
import torch

from studies.false_names.drawn import HIDDEN, TESTED, Drawn, draw
from terrain_estimator.discovery.evidence.verdict import Verdict
from terrain_estimator.discovery.hypotheses.library import NOTHING
from terrain_estimator.discovery.single_wheel.cells import cells_of
from terrain_estimator.discovery.single_wheel.investigation import (
    investigate_wheel,
    judge_rows,
    lacking_in_reference,
    loosened,
    shown_by_one_wheel,
    weigh,
)
from terrain_estimator.discovery.single_wheel.size import change

SIDEWAYS = "lateral_bulldozing"
PULL = "drawbar_pull"
SAID = (Verdict.NAMED, Verdict.CONFUSABLE)
"""Verdicts that name an effect."""


@dataclass(frozen=True, slots=True)
class Judged:
    """The verdict about one laboratory, and the truth."""

    number: int
    hidden: str  # empty: nothing
    laws: str  # of the soil
    reference: bool
    settings: int
    verdict: str
    named: list[str]  # of several alternatives all
    reference_lacks: list[str]
    gain: float  # [nat] of the best family over no name
    proven: bool | None
    size: tuple[float, float, float] | None  # [N] change of drawbar pull, 95 % interval
    true_size: float | None  # [N]

    @property
    def names(self) -> bool:
        """Whether any effect is named, of the tables or of their reference."""
        return self.verdict in SAID or bool(self.reference_lacks)


def judged(seed: int, number: int, hidden: str) -> Judged:
    """Draw one laboratory and judge its tables as the command does."""
    torch.set_num_threads(1)
    kind = HIDDEN.index(hidden) + 1 if hidden else 0
    drawn = draw(np.random.default_rng([seed, number, kind]), hidden)
    bed, rows, reference = drawn.bed, drawn.rows, drawn.reference
    names = [each for each in shown_by_one_wheel() if each != SIDEWAYS]
    with torch.inference_mode():
        lacking = lacking_in_reference(bed, rows, reference, NOTHING, names, _silent)
        names = [each for each in names if each not in lacking.names]
        cells = cells_of(rows, reference)
        _, weighed, _ = weigh(loosened(bed), lacking, cells, names)
        judgement, proven, size = judge_rows(weighed, rows, names), None, None
        # held-out settings can only withdraw a name
        if judgement.verdict in SAID:
            found = investigate_wheel(bed, rows, reference, lacking, names, _silent)
            judgement, proven = found.judgement, found.proven
            if found.added.effects:
                family = found.family(found.added)
                size = change(found.bed, cells, lacking, family).rows[PULL]
    soil, said = drawn.soil, judgement.verdict in SAID
    return Judged(
        number,
        hidden,
        f"{soil.pressure}, {soil.shear}, {soil.distribution}",
        bool(reference),
        int(cells.acts.sum()),
        str(judgement.verdict),
        [name for each in judgement.named for name in each.names] if said else [],
        list(lacking.names),
        weighed.gain(weighed.families[0], {}),
        proven,
        size,
        _true_size(drawn) if hidden else None,
    )


def _true_size(drawn: Drawn) -> float:
    """Return the change of drawbar pull [N] at slip 0.3 and the middle load of the tables."""
    loads = sorted(row.load for row in drawn.rows if row.table == TESTED)
    load = loads[(len(loads) - 1) // 2]
    return drawn.tested.state(0.3, load)[1] - drawn.plain.state(0.3, load)[1]


def _silent(share: float, note: str) -> None:
    del share, note
