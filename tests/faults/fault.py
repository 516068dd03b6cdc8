# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0

"""One row of the fault matrix: the fault, the expected result, and the observed one."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Expected:
    """Expected result of a fault, with every line of the log from WARN on."""

    outcomes: frozenset[
        str
    ]  # of the observations while the fault lasts; "none" where there was no answer
    diagnostics: dict[
        str, str
    ]  # worst level by check while the fault lasts, without those that are OK
    perhaps: frozenset[str] = frozenset()  # checks that may have been something else than OK too
    log: tuple[str, ...] = ()  # patterns of the lines from WARN on, each of which has to come
    back_after: int = (
        0  # sound observations that are refused or not answered after the end of the fault
    )
    lost: int = 0  # sound observations
    kept: bool = True  # what was known of the ground
    at_most: bool = False  # not every outcome has to come, and the numbers are the largest ones


@dataclass(frozen=True, slots=True)
class Seen:
    """Observed result of a fault."""

    outcomes: dict[str, int]
    diagnostics: dict[str, str]
    log: tuple[str, ...]
    back_after: int
    back_after_s: (
        float  # from the end of the fault to the first accepted estimate, or to what stands for it
    )
    lost: int
    kept: bool
    well_again: bool  # /diagnostics at the end
    unsound: tuple[
        str, ...
    ] = ()  # published numbers that are not finite, covariances that are not positive definite


class Run(Protocol):
    """Function that applies a fault to real processes."""

    def __call__(self, folder: Path, domain_id: int) -> Seen:
        """Run in a ROS domain of its own, with the processes' output in the folder."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One row of the matrix."""

    name: str
    what: str
    expected: Expected
    run: Run
    lost_is: str = "observations"  # of which ``Expected.lost`` counts


def complaints(fault: Fault, seen: Seen) -> list[str]:
    """Return the differences from the expected result in words; empty where there is none."""
    expected = fault.expected
    found = [*seen.unsound]
    lost, back_after, outcomes = expected.lost, expected.back_after, set(expected.outcomes)
    if expected.at_most:
        lost, back_after, outcomes = (
            min(lost, seen.lost),
            min(back_after, seen.back_after),
            outcomes & set(seen.outcomes),
        )
    diagnostics = {
        name: level for name, level in seen.diagnostics.items() if name not in expected.perhaps
    }
    pairs = {
        "outcomes": (outcomes, set(seen.outcomes)),
        "diagnostics": (expected.diagnostics, diagnostics),
        "refused or unanswered after it": (back_after, seen.back_after),
        "lost": (lost, seen.lost),
        "what was known is kept": (expected.kept, seen.kept),
        "diagnostics are well again": (True, seen.well_again),
    }
    found += [
        f"{name}: expected {right}, got {got}"
        for name, (right, got) in pairs.items()
        if right != got
    ]
    found += [
        f"log: nothing matches {pattern!r}"
        for pattern in expected.log
        if not any(re.search(pattern, line) for line in seen.log)
    ]
    found += [
        f"log: not expected: {line}"
        for line in seen.log
        if not any(re.search(pattern, line) for pattern in expected.log)
    ]
    return found
