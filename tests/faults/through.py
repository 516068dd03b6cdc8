# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A fault of a running estimator, with sound driving before and after."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from terrain_estimator.topics import stamp_ns
from tests.faults.fault import Expected, Fault, Seen
from tests.faults.logs import worst_levels
from tests.faults.rover import PATIENCE_S, Rover, Sent
from tests.soundness import unsound
from tests.system.processes import Process

BEFORE_S = 3
SETTLE_S = 3.5
"""[s] Sound driving after a fault, until /diagnostics, once a second, is OK again."""
_FORGOTTEN = 5
"""[observations] Loss allowed for a restarted node: half a second."""
Happen = Callable[[Rover, Process], None]


def of_estimator(
    name: str,
    what: str,
    happen: Happen,
    expected: Expected,
    parameters: Callable[[Path], dict[str, str]] = lambda _: {},
) -> Fault:
    """Row of an estimator's fault; ``parameters`` may prepare the folder that they name."""

    def run(folder: Path, domain_id: int) -> Seen:
        with Rover(folder, domain_id) as rover:
            estimator = rover.estimator(parameters(folder))
            rover.match(estimator)
            for _ in range(BEFORE_S):
                rover.drive(1.0)
                rover.listener.spin_until(
                    lambda: len(rover.estimates) == len(rover.sent), "all is answered", PATIENCE_S
                )
            mark = Mark.of(rover)
            happen(rover, estimator)
            during = rover.sent[mark.sent :]
            rover.end_fault()
            rover.wait_for_matches()
            rover.drive_until_accepted()
            rover.drive(SETTLE_S)
            rover.listener.spin_until(
                lambda: rover.accepted(rover.sent[-1:]),
                "the last observation is accepted",
                PATIENCE_S,
            )
            return mark.seen(rover, during)

    return Fault(name, what, expected, run)


@dataclass(frozen=True, slots=True)
class Mark:
    """Counts at the start of the fault."""

    sent: int
    diagnostics: int
    lines: int
    known: int

    @classmethod
    def of(cls, rover: Rover) -> Self:
        """Take the counts now."""
        return cls(
            len(rover.sent),
            len(rover.diagnostics),
            len(rover.log_lines()),
            rover.estimates[-1][1].observations_used,
        )

    def seen(self, rover: Rover, during: list[Sent]) -> Seen:
        """Return the result of the fault, during which ``during`` was published."""
        over, end_s = rover.end
        accepted = {stamp_ns(each) for _, each in rover.accepted(rover.sent)}
        back_after = next(
            at for at, each in enumerate(rover.sent[over:]) if each.stamp_ns in accepted
        )
        back_s, back = rover.accepted(rover.sent[over:])[0]
        answers = {stamp_ns(each): each.decision.outcome_name for _, each in rover.estimates}
        return Seen(
            outcomes=dict(Counter(answers.get(each.stamp_ns, "none") for each in during)),
            diagnostics=worst_levels(rover.diagnostics[self.diagnostics :], "estimator"),
            log=tuple(dict.fromkeys(rover.log_lines()[self.lines :])),
            back_after=back_after,
            back_after_s=back_s - end_s,
            lost=sum(
                each.sound and each.stamp_ns not in accepted for each in rover.sent[self.sent :]
            ),
            kept=back.observations_used >= self.known - _FORGOTTEN,
            well_again=not worst_levels(rover.diagnostics[-1:], "estimator"),
            unsound=tuple(
                text
                for message in (*(each for _, each in rover.estimates), *rover.predictions)
                for text in unsound(message)
            ),
        )
