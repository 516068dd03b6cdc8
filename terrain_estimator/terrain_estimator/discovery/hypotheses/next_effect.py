# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One more effect in equations that are known without it: its columns alone, as differences.

For effects with two signs, whose fits begin without them. A whole evaluation takes twice as long.
"""

import dataclasses
from dataclasses import dataclass

import torch

from terrain_estimator.discovery.hypotheses.doubted_rows import rows_of
from terrain_estimator.discovery.hypotheses.equations import Equations, linear
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.rows import (
    LinearizationPoint,
    Nominal,
)
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.runs import Blocks


@dataclass(frozen=True, slots=True)
class Known:
    """A run's equations without the effect, and where they were evaluated."""

    unknowns: Unknowns
    sizes: tuple[float, ...]  # values of the effects that act already
    equations: Equations


@dataclass(frozen=True, slots=True)
class NextEffectTask:
    """The columns of the last effect of a hypothesis, for one run after the other."""

    nominal: Nominal
    hypothesis: Hypothesis
    steps: tuple[float, ...]  # of the differences by each of the effect's values

    @torch.inference_mode()
    def __call__(self, blocks: Blocks, known: Known) -> Equations:
        """Return the equations of a run with the effect's values, which are 0, as last unknowns."""
        rows = rows_of(self.nominal, blocks, self.hypothesis)
        unknowns, none = known.unknowns, known.equations
        columns = [none.jacobian]
        for k, step in enumerate(self.steps):
            values = (step * (n == k) for n in range(len(self.steps)))
            point = LinearizationPoint(unknowns.theta, unknowns.kappa, (*known.sizes, *values))
            varied = rows.corrected(point, none.around, none.error).view(none.corrected.shape)
            change = none.average.of((varied - none.corrected) / step)
            columns.append(change.unsqueeze(-1))
        found = dataclasses.replace(none, jacobian=torch.cat(columns, -1))
        unmoved = torch.zeros(none.hessian.shape[0] + len(self.steps), dtype=torch.float64)
        return linear(found, unmoved, len(known.sizes) + len(self.steps))
