# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Journal of changes in words: the last events that lasted."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

KEPT = 100
HOLD_S = 1.0
"""[s] Least duration of an event; only the timeline shows shorter ones."""


@dataclass(frozen=True, slots=True)
class Event:
    """One change."""

    number: int
    time_s: float  # stamp at which it began
    level: str  # ok, warn, error
    text: str


@dataclass(slots=True)
class _Lane:
    """One thing that has a state at every time."""

    state: str
    candidate: str = ""
    since_s: float = 0.0


@dataclass(slots=True)
class Journal:
    """Numbered events of lanes that each have one state at a time."""

    _events: deque[Event] = field(default_factory=lambda: deque(maxlen=KEPT))
    _lanes: dict[str, _Lane] = field(default_factory=dict)
    _count: int = 0

    @property
    def end(self) -> int:
        """Number of the next event."""
        return self._count

    def see(self, lane: str, state: str, time_s: float, level: str, text: str) -> None:
        """Note the present state of a lane; it becomes an event once it has lasted.

        The first state is no event if it is empty.
        """
        known = self._lanes.setdefault(lane, _Lane(""))
        if state == known.state:
            known.candidate = state
        elif state != known.candidate:
            known.candidate, known.since_s = state, time_s
        elif time_s - known.since_s >= HOLD_S:
            known.state = state
            self.write(known.since_s, level, text)

    def write(self, time_s: float, level: str, text: str) -> None:
        """Add an event."""
        self._events.append(Event(self._count, time_s, level, text))
        self._count += 1

    def since(self, number: int) -> Iterator[Event]:
        """Return the events from this number on that are still kept."""
        return (event for event in self._events if event.number >= number)
