# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Result of the replay of one bag."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from terrain_estimator.bags import Message, bag_name
from terrain_estimator.messaging.averaging import RateCounts
from terrain_estimator.messaging.health import RefusalCounts
from terrain_estimator.messaging.history import RunHistory, WheelHistory
from terrain_estimator.messaging.pairing import Counters, MessageSet
from terrain_estimator.messaging.pipeline import Answer
from terrain_estimator.messaging.sequence_numbers import Sequences
from terrain_estimator.messaging.settled import SettledOutcomes
from terrain_estimator.update import Disagreement


@dataclass(slots=True)
class Replay:
    """Result of the replay of one bag."""

    bag: Path
    estimates_bag: Path = Path()  # empty where none was written
    name: str = ""  # of the run; empty: that of the bag
    runtime: str = ""  # what ran the model
    configuration_sha256: str = ""  # with that runtime
    state_sha256: str = ""  # of the file of the state that it started from
    missing_s: float | None = 0.0  # at the end of an unfinished bag; None where it is unknown
    notes: list[str] = field(default_factory=list)
    wall_s: float = 0.0  # of reading, estimating and writing, without loading anything
    estimates: int = 0
    inputs: dict[str, Counters] = field(default_factory=dict)
    # of msg_defs messages apart from the inputs, by topic of the bag
    sequences: Sequences = field(default_factory=Sequences)
    first: Answer | None = None
    last: Answer | None = None
    status: str = ""
    status_text: str = ""  # of the last estimate, as its message has it
    # grows only with the changes of the simulated ground
    truths: list[Message] = field(default_factory=list)
    history: RunHistory = field(default_factory=RunHistory)
    slip: WheelHistory = field(default_factory=WheelHistory)
    sinkage: WheelHistory = field(default_factory=WheelHistory)
    rates: RateCounts = field(default_factory=RateCounts)
    refusals: RefusalCounts = field(default_factory=RefusalCounts)
    # by topic, empty where identical to live; None where not compared
    differences: dict[str, str] | None = None

    def __post_init__(self) -> None:
        """Name the run by its bag where it has no name of its own."""
        self.name = self.name or bag_name(self.bag)

    def keep_wheels(self, complete: MessageSet) -> None:
        """Record the wheels' measurements of one instant."""
        slip, sinkage, *_ = complete.messages
        self.slip.add(complete.stamp_ns, slip.wheel, slip.slip)
        self.sinkage.add(complete.stamp_ns, sinkage.wheel, sinkage.sinkage)

    def keep_rows(self, sets: list[MessageSet]) -> None:
        """Record the wheels' measurements of many instants, all of the same columns."""
        stamps = [complete.stamp_ns for complete in sets]
        for index, (history, name) in enumerate(((self.slip, "slip"), (self.sinkage, "sinkage"))):
            rows = [complete.messages[index] for complete in sets]
            columns = rows[0].columns
            values = columns.values[name][[row.at for row in rows]]
            history.add_rows(stamps, columns.example.wheel, values)

    @property
    def settled(self) -> SettledOutcomes:
        """Observations and seconds by what became of them."""
        return self.history.settled

    @property
    def learnt(self) -> bool:
        """Return whether an observation was used; otherwise the last estimate is the prior."""
        return self.settled.used > 0

    @property
    def disagreements(self) -> tuple[Disagreement, ...]:
        """Reasons why the model does not fit at the end, for which the prior is published."""
        return self.last.update.disagreements if self.last else ()

    @property
    def gave_estimate(self) -> bool:
        """Return whether the last estimate is one: something was learnt, by a model that fits."""
        return self.learnt and not self.disagreements

    @property
    def truth(self) -> Message | None:
        """Last true ground; None where the bag has none."""
        return self.truths[-1] if self.truths else None

    @property
    def span_s(self) -> float:
        """Time [s] between the stamps of the first and the last estimate."""
        return (
            (self.last.update.stamp_ns - self.first.update.stamp_ns) / 1e9
            if self.first and self.last
            else 0.0
        )

    @property
    def times_real_time(self) -> float:
        """Speed of the replay relative to the recording."""
        return self.span_s / self.wall_s if self.wall_s > 0.0 else math.nan
