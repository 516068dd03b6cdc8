# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The contribution of each run to a fit, computed here or wherever the runs lie."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.doubted_rows import rows_of
from terrain_estimator.discovery.hypotheses.equations import Equations, Query, RunEquations
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.runs import Blocks

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class ContributionTask:
    """A hypothesis to evaluate on one run after the other."""

    nominal: Nominal
    hypothesis: Hypothesis
    mask: Tensor  # [R] 1 for rows that may be used

    @torch.inference_mode()
    def __call__(self, blocks: Blocks, query: Query) -> Equations:
        """Return the equations of a run at a point."""
        rows = rows_of(self.nominal, blocks, self.hypothesis)
        return RunEquations(blocks, rows, self.mask).at(query)


class Contributions(Protocol):
    """A function that applies another one to every run that it holds, with an item for each.

    Results come in the order of the runs whoever computed them, so that they are added up in that
    order.
    """

    def __call__(
        self, function: Callable[[Blocks, Item], Result], items: Sequence[Item], /
    ) -> Sequence[Result]:
        """Return ``function(run, item)`` of every run."""


def here(runs: Sequence[Blocks]) -> Contributions:
    """Return the contributions of runs in this process, one after the other."""

    def contributions(
        function: Callable[[Blocks, Item], Result], items: Sequence[Item], /
    ) -> Sequence[Result]:
        return [function(run, item) for run, item in zip(runs, items, strict=True)]

    return contributions
