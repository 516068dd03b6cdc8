# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Missing messages, by sequence numbers that count a publisher's messages from 0 without gaps."""

from collections import Counter, defaultdict
from dataclasses import dataclass, field

GAPS = 64
"""Number of the newest gaps kept; a message older than these stays lost."""


@dataclass(slots=True)
class Sequence:
    """Sequence numbers of one publisher's messages, and the missing ones."""

    _last: int | None = None
    # the newest number, where it is neither missing nor after the last one
    _again: int | None = None
    _gaps: list[range] = field(default_factory=list)

    def note(self, number: int) -> int:
        """Take the next message; return the number of messages missing before it.

        A smaller number is a copy of a message. Two smaller ones in a row that increase mean
        that the publisher restarted, which is no gap.
        """
        if self._last is None:
            self._last = number
        last, again = self._last, self._again
        if number <= last:
            if again is None or not (number == again + 1 or again < number < last):
                self._again = number if number < last else again
                return 0
            self._gaps.clear()
            last = again
        self._last, self._again = number, None
        if number == last + 1:
            return 0
        self._gaps = [*self._gaps, range(last + 1, number)][-GAPS:]
        return number - last - 1

    def fill(self, number: int) -> bool:
        """Return whether a possibly late message was missing until now; it no longer is."""
        for at, gap in enumerate(self._gaps):
            if number in gap:
                self._gaps[at : at + 1] = [
                    rest for rest in (range(gap.start, number), range(number + 1, gap.stop)) if rest
                ]
                return True
        return False

    def restart(self) -> None:
        """Begin again: the next number has no predecessor."""
        self._last = self._again = None
        self._gaps.clear()


class Sequences:
    """Counts, by topic, of missing messages and of those that came after their successors."""

    def __init__(self) -> None:
        """Begin without topics."""
        self.lost: Counter[str] = Counter()
        self.late: Counter[str] = Counter()
        self._topics: defaultdict[str, Sequence] = defaultdict(Sequence)

    def note(self, topic: str, number: int) -> None:
        """Take the next message of a topic."""
        sequence = self._topics[topic]
        if sequence.fill(number):
            self.lost[topic] -= 1
            self.late[topic] += 1
        else:
            self.lost[topic] += sequence.note(number)
