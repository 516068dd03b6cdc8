# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The targets of ``make stream``: of each the cell that is farthest off, and whether it is met."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from studies.limited import Limited
from studies.stream.scores import StrengthScore

FEWEST = 100
"""[1] Drives below which a share is not judged."""
LARGEST_SHIFT = 0.3
"""[published deviations] Of the mean error."""


class Target(NamedTuple):
    """A range that a figure of every cell should reach; None where a cell has no such figure."""

    what: str
    text: str
    low: float
    high: float
    of: Callable[[StrengthScore], Limited | None]


TARGETS = (
    Target("in the 95 % interval", "93 to 97 %", 0.93, 0.97, lambda each: each.inside_95),
    Target("in the 68 % interval", "64 to 72 %", 0.64, 0.72, lambda each: each.inside_68),
    Target(
        "mean of error over deviation",
        f"within {LARGEST_SHIFT}",
        -LARGEST_SHIFT,
        LARGEST_SHIFT,
        lambda each: each.shift,
    ),
    Target(
        f"IDENTIFIED, of those whose bound is ({FEWEST} drives or more)",
        "at least 90 %",
        0.9,
        1.0,
        lambda each: each.identified_of_known if each.known >= FEWEST else None,
    ),
    Target(
        f"error over bound, where the bound identifies {FEWEST} drives or more",
        "at most 1.15",
        0.0,
        1.15,
        lambda each: each.of_bound if each.known >= FEWEST else None,
    ),
)


class Worst(NamedTuple):
    """The cell that is farthest from a target."""

    target: Target
    found: Limited
    cell: str
    missed: int  # cells whose limits exclude the target
    cells: int


def worst_of(target: Target, scores: Sequence[tuple[str, StrengthScore]]) -> Worst | None:
    """Return the worst of named scores; None where none has such a figure."""
    found = [(figure, name) for name, each in scores if (figure := target.of(each))]
    if not found:
        return None
    missed = sum(each.high < target.low or each.low > target.high for each, _ in found)
    middle = 0.5 * (target.low + target.high)
    one_sided = target.low == 0.0 or target.high == 1.0

    def off(figure: Limited) -> float:
        if one_sided:
            return figure.value if target.low == 0.0 else -figure.value
        return abs(figure.value - middle)

    figure, name = max(found, key=lambda each: off(each[0]))
    return Worst(target, figure, name, missed, len(found))
