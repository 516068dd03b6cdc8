# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What each run contributes to a fit, computed run by run, here or wherever the runs lie."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.equations import Equations, Query, RunEquations
from terrain_estimator.discovery.hypotheses.library import NamedEffect
from terrain_estimator.discovery.hypotheses.rows import HypothesisRows, Nominal
from terrain_estimator.discovery.runs import Blocks

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class ContributionTask:
    """A hypothesis, the same for all runs; called on one run, it gives what that contributes at a point."""

    nominal: Nominal
    effects: tuple[NamedEffect, ...]
    mask: Tensor  # [R] 1 for rows that may be used

    @torch.inference_mode()
    def __call__(self, blocks: Blocks, query: Query) -> Equations:
        """The equations of a run."""
        return RunEquations(
            blocks, HypothesisRows(self.nominal, blocks, self.effects), self.mask
        ).at(query)


class Contributions(Protocol):
    """Applies a function to every run that it holds, with an item for each.

    Results come in the order of the runs whoever computed them, so that they are added up in that
    order.
    """

    def __call__(
        self, function: Callable[[Blocks, Item], Result], items: Sequence[Item], /
    ) -> Sequence[Result]:
        """``function(run, item)`` of every run."""


def here(runs: Sequence[Blocks]) -> Contributions:
    """The contributions of runs in this process, one after the other."""

    def contributions(
        function: Callable[[Blocks, Item], Result], items: Sequence[Item], /
    ) -> Sequence[Result]:
        return [function(run, item) for run, item in zip(runs, items, strict=True)]

    return contributions
