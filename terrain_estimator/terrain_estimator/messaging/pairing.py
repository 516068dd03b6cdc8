# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pair the messages of several topics by their stamps; every dropped message is counted.

The sets depend on the stamps alone, not on the order in which the topics' messages arrive, as long
as one topic is not ahead of the others by more than the time-out (the messages of ONE topic arrive
in order: DDS and bags keep it). There is no clock here: time-outs are measured in stamps, so a bag
replayed at full speed gives the same sets as live.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from terrain_estimator.config.estimator import PairingConfig
from terrain_estimator.messaging.sequence_numbers import Sequence
from terrain_estimator.messaging.sizes import message_bytes
from terrain_estimator.topics import REQUIRED_INPUTS, Message

# messages, and bytes of messages, kept per topic; older ones are counted as unpaired
CAPACITY, CAPACITY_BYTES = 1024, 1 << 23
# messages in a row before the last stamp after which the publisher's clock counts as set back
RESTART_AFTER = 10


@dataclass(frozen=True, slots=True)
class InputTopic:
    """One input topic.

    The first topic of a synchronizer is the reference: the sets have its stamps.
    """

    name: str
    required: bool


@dataclass(slots=True)
class Counters:
    """Counts of the messages of one topic since the start."""

    received: int = 0
    paired: int = 0
    unpaired: int = 0  # no partner came, or they came for a set that was already released
    out_of_order: int = 0  # stamp not after the predecessor's, duplicates among them
    lost: int = 0  # gaps in the sequence numbers that nothing filled later


@dataclass(frozen=True, slots=True)
class MessageSet:
    """Messages of one instant, in the order of the topics; None for a missing optional one."""

    stamp_ns: int
    messages: tuple[Message, ...]


@dataclass(slots=True)
class _Input:
    """Waiting messages of one topic, by increasing stamp."""

    topic: InputTopic
    counters: Counters = field(default_factory=Counters)
    waiting: deque[tuple[int, Message, int]] = field(default_factory=deque)  # with bytes
    waiting_bytes: int = 0
    latest_ns: int = -1  # stamp of the last message taken
    sequence: Sequence = field(default_factory=Sequence)
    backwards: int = 0  # messages in a row that were not after latest_ns
    backwards_ns: int = -1  # stamp of the last of them

    def keep(self, stamp_ns: int, message: Message, size: int) -> None:
        """Add a message of a size [B]; drop the oldest ones beyond the capacity."""
        self.waiting.append((stamp_ns, message, size))
        self.waiting_bytes += size
        while len(self.waiting) > CAPACITY or self.waiting_bytes > CAPACITY_BYTES:
            self.drop()

    def take(self) -> Message:
        """Remove and return the oldest message."""
        _, message, size = self.waiting.popleft()
        self.waiting_bytes -= size
        return message

    def drop(self) -> None:
        """Remove the oldest message, which has no partner."""
        self.take()
        self.counters.unpaired += 1

    def drop_all(self) -> None:
        """Remove all messages."""
        while self.waiting:
            self.drop()


class Synchronizer:
    """Pair the messages of ``topics`` whose stamps agree within ``tolerance_ns``, nearest first.

    A set is released as soon as every topic has its message, or cannot have one any more: its
    stamps have passed the set's, or those of two topics have passed it by ``timeout_ns`` (two, so
    that one wrong clock does not time out all). Sets come in the order of their stamps. A set
    without a required message is not released.
    """

    def __init__(
        self, topics: tuple[InputTopic, ...], tolerance_ns: int = 0, timeout_ns: int = 500_000_000
    ) -> None:
        """Start without messages; ValueError unless ``topics[0]``, the reference, is required."""
        if not topics or not topics[0].required:
            raise ValueError(
                f"the first of the topics {[topic.name for topic in topics]} is the reference: it"
                " must be required"
            )
        self._inputs = [_Input(topic) for topic in topics]
        self._reference, self._others = self._inputs[0], self._inputs[1:]
        self._tolerance_ns = tolerance_ns
        self._timeout_ns = max(timeout_ns, 1)  # messages of one instant are not late

    @property
    def counters(self) -> dict[str, Counters]:
        """Live counters by topic."""
        return {entry.topic.name: entry.counters for entry in self._inputs}

    def add(
        self,
        index: int,
        stamp_ns: int,
        message: Message,
        sequence: int | None = None,
        size: int | None = None,
    ) -> list[MessageSet]:
        """Add a message of ``topics[index]``; return the sets that it completes.

        ``size`` [B] is that of the message in memory, where it is known already.
        """
        entry = self._inputs[index]
        entry.counters.received += 1
        if stamp_ns <= entry.latest_ns and not self._restarted(entry, stamp_ns):
            entry.counters.out_of_order += 1
            if sequence is not None and entry.sequence.fill(sequence):
                entry.counters.lost -= 1
            return []
        if sequence is not None:
            entry.counters.lost += entry.sequence.note(sequence)
        entry.latest_ns, entry.backwards = stamp_ns, 0
        entry.keep(stamp_ns, message, message_bytes(message) if size is None else size)
        return self._release()

    def flush(self) -> list[MessageSet]:
        """Release the complete sets and count the rest as unpaired.

        For the end of the input, or before a pause. Messages published during a pause do not count
        as lost: the sequence numbers begin again.
        """
        sets = self._release(ended=True)
        for entry in self._inputs:
            entry.drop_all()
            entry.sequence.restart()
        return sets

    def reset(self) -> None:
        """Forget the waiting messages and the stamps, but keep the counters.

        Needed when a bag loops or a clock was set back.
        """
        for entry in self._inputs:
            _forget(entry)

    def _restarted(self, entry: _Input, stamp_ns: int) -> bool:
        """Return whether this topic's clock was set back for good; if so, accept its stamps.

        Without this, one stamp from the far future would silence a topic for ever.
        """
        entry.backwards = (
            entry.backwards + 1 if stamp_ns > entry.backwards_ns or entry.backwards == 0 else 1
        )
        entry.backwards_ns = stamp_ns
        if entry.backwards < RESTART_AFTER:
            return False
        _forget(entry)
        if entry is self._reference:
            self._follow(stamp_ns)
        return True

    def _follow(self, stamp_ns: int) -> None:
        """Forget other topics that are still ahead after the reference's clock was set back.

        They must not wait for the earlier time to come again.
        """
        for other in self._others:
            if other.latest_ns > stamp_ns + self._timeout_ns:
                _forget(other)

    def _release(self, *, ended: bool = False) -> list[MessageSet]:
        sets: list[MessageSet] = []
        waiting = self._reference.waiting
        while waiting:
            stamp_ns = waiting[0][0]
            if not ended and not self._resolved(stamp_ns):
                break
            complete = self._take(stamp_ns)
            if complete is not None:
                sets.append(complete)
        return sets

    def _resolved(self, stamp_ns: int) -> bool:
        for entry in self._others:
            if entry.latest_ns < stamp_ns:
                break
        else:
            return True
        late_ns = stamp_ns + self._timeout_ns
        return [entry.latest_ns >= late_ns for entry in self._inputs].count(True) > 1

    def _take(self, stamp_ns: int) -> MessageSet | None:
        """Take the head of the reference and its partners; None where a required one is missing."""
        found = [self._nearest(entry, stamp_ns) for entry in self._others]
        complete = None not in found or all(
            at is not None or not entry.topic.required
            for at, entry in zip(found, self._others, strict=True)
        )
        messages = [self._reference.take()]
        if not complete:
            self._reference.counters.unpaired += 1
            return None
        self._reference.counters.paired += 1
        for at, entry in zip(found, self._others, strict=True):
            messages.append(None if at is None else _consume(entry, at))
        return MessageSet(stamp_ns, tuple(messages))

    def _nearest(self, entry: _Input, stamp_ns: int) -> int | None:
        """Return the position of the message nearest to ``stamp_ns`` within the tolerance.

        Messages that are too old are dropped and counted.
        """
        waiting, tolerance_ns = entry.waiting, self._tolerance_ns
        while waiting and waiting[0][0] < stamp_ns - tolerance_ns:
            entry.drop()
        best, distance = None, tolerance_ns
        for at, (candidate_ns, _, _) in enumerate(waiting):
            gap = abs(candidate_ns - stamp_ns)
            if gap < distance or (gap == distance and best is None):
                best, distance = at, gap
            if candidate_ns >= stamp_ns:
                break
        return best


def input_synchronizer(names: Iterable[str], config: PairingConfig) -> Synchronizer:
    """Return a synchronizer of the estimator's inputs ``names``, as its parameters define it."""
    topics = tuple(InputTopic(name, name in REQUIRED_INPUTS) for name in names)
    return Synchronizer(topics, round(config.tolerance_s * 1e9), round(config.timeout_s * 1e9))


def _consume(entry: _Input, at: int) -> Message:
    for _ in range(at):
        entry.drop()
    entry.counters.paired += 1
    return entry.take()


def _forget(entry: _Input) -> None:
    entry.drop_all()
    entry.latest_ns, entry.backwards, entry.backwards_ns = -1, 0, -1
    entry.sequence.restart()
