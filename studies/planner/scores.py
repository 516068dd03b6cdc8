# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of drives into soft patches."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch

from studies.accuracy.scores import share_of
from studies.limited import Limited
from studies.planner.patches import PatchOutcome


@dataclass(frozen=True, slots=True)
class PatchScore:
    """Figures of some drives; shares with their exact limits."""

    drives: int  # that met their patch
    trapped: int  # that get stuck without the planner
    saved: Limited | None  # of the trapped; None where there is none
    firm_axles: float  # mean number of axles not yet on the patch at the stop of a saved rover
    slip: float  # largest true slip when a saved rover was stopped
    false_stops: Limited | None  # of the drives that pass without the planner
    too_weak: int  # false stops on ground that does not hold the rover; the patch is short
    early: int  # stops before the patch was met, trapped or not


def score(outcomes: Sequence[PatchOutcome]) -> PatchScore:
    """Score the drives that met their patch."""
    counted = [outcome for outcome in outcomes if outcome.counts]
    trapped = [outcome for outcome in counted if outcome.trapped]
    saved = [outcome for outcome in trapped if outcome.saved]
    false = [outcome for outcome in counted if outcome.false_stop]
    return PatchScore(
        drives=len(counted),
        trapped=len(trapped),
        saved=_share(outcome.saved for outcome in trapped),
        firm_axles=sum(3 - outcome.axles for outcome in saved) / max(len(saved), 1),
        slip=max((outcome.slip for outcome in saved), default=0.0),
        false_stops=_share(outcome.false_stop for outcome in counted if not outcome.trapped),
        too_weak=sum(not outcome.holds for outcome in false),
        early=sum(outcome.stop_s < outcome.met_s for outcome in counted),
    )


def _share(flags: Iterable[bool]) -> Limited | None:
    chosen = torch.tensor(list(flags), dtype=torch.bool)
    return share_of(chosen) if chosen.numel() else None
