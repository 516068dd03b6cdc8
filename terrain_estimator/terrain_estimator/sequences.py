# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What is missing by the sequence numbers of messages, which count a publisher's messages from 0 without gaps."""

from collections import Counter


def missing(before: int, sequence: int) -> int:
    """Number of messages missing between two; none after a smaller number, which is a publisher that started again."""
    return max(0, sequence - before - 1)


class Sequences:
    """Counts by topic what is missing between the messages that are noted."""

    def __init__(self) -> None:
        """Begin with no topic."""
        self.lost: Counter[str] = Counter()
        self._last: dict[str, int] = {}

    def note(self, topic: str, sequence: int) -> None:
        """Take the next message of a topic."""
        self.lost[topic] += missing(self._last.get(topic, sequence), sequence)
        self._last[topic] = sequence
