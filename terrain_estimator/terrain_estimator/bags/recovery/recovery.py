# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Make a whole bag from what is left of a damaged one, and account for what is lost."""

import os
import struct
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from mmap import ACCESS_READ, mmap
from pathlib import Path

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, McapRecord, Message, Metadata, Schema, Statistics

from rover_parameters.regular_file import open_regular
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.metadata import (
    METADATA_FILE,
    StoredMetadata,
    TimeSpan,
    TopicCount,
    dump,
    information,
    read_metadata,
    write_metadata,
)
from terrain_estimator.bags.format.qos import parse_qos
from terrain_estimator.bags.reading import sqlite_file
from terrain_estimator.bags.reading.reader import numbered_files
from terrain_estimator.bags.reading.records import MAGIC, Record, parse
from terrain_estimator.bags.recovery.salvage import Damage, parsed, salvage
from terrain_estimator.bags.writing.copying import Copier
from terrain_estimator.files.atomic import discard


@dataclass(slots=True)
class Recovery:
    """Result of the recovery of a damaged bag."""

    span: TimeSpan = field(default_factory=TimeSpan)  # of the messages that were recovered
    gaps: int = 0  # messages missing between others, by the sequence numbers of their topics
    expected: int | None = (
        None  # messages in the original, where metadata.yaml or the files state it
    )
    damage: Damage = field(default_factory=Damage)
    # messages that the end of the last file cuts; what follows a cut elsewhere is a gap
    cut: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def lost(self) -> int:
        """Number of messages known to be lost.

        Where ``expected`` is None, more may be missing at the end.
        """
        return max(self.gaps + self.cut, (self.expected or 0) - self.span.count)

    @property
    def words(self) -> str:
        """What was recovered, and what was lost."""
        damage, span = self.damage, self.span
        if not span.count:
            return "; ".join(["no message is left", *self.notes])
        parts = [f"{span.count} messages in {span.duration_ns / 1e9:.3f} s recovered"]
        if self.expected is None:
            parts.append(
                f"{self.lost or 'none'} lost before the last one; it is unknown whether"
                " more followed"
            )
        else:
            parts.append(f"{self.lost or 'none'} of {self.expected} lost")
        if damage.torn:
            parts.append(f"{damage.torn} cut off")
        if damage.chunks:
            parts.append(f"{damage.chunks} chunks damaged")
        if damage.passed_over:
            parts.append(f"{damage.passed_over} bytes unreadable")
        return "; ".join([", ".join(parts), *self.notes])


def recover(source: Path, target: Path) -> Recovery:
    """Write what can be read of a bag folder or MCAP file to a new bag; ``source`` is not touched.

    Raises:
        BagError: there is no bag, or the target exists already.
        OSError: the disk is full or broken.

    Nothing is left of the target after an error, or where no message could be recovered.
    """
    if not source.exists():
        raise BagError(f"{source} does not exist: give a bag folder or an .mcap file")
    _refuse_databases(source)
    files = numbered_files(source) if source.is_dir() else [source]
    try:
        target.mkdir(parents=True)
    except FileExistsError as error:
        raise BagError(
            f"{target} exists already: choose another name, bags are never overwritten"
        ) from error
    result = Recovery()
    try:
        _Recovering(source, target, result).run(files)
    finally:
        if not result.span.count:
            discard(target)
    return result


def _refuse_databases(source: Path) -> None:
    """Refuse a bag of storage sqlite3: SQLite recovers its own files."""
    paths = source.glob("*.db3") if source.is_dir() else [source]
    for path in paths:
        with open_regular(path) as file:
            if path.suffix == ".db3" or file.read(len(sqlite_file.MAGIC)) == sqlite_file.MAGIC:
                raise BagError(
                    f"{path}: only MCAP files are recovered here; for a database call `sqlite3"
                    f" {path.name} .recover | sqlite3 whole.db3`, then `ros2 bag reindex`"
                )


class _Recovering:
    """State of one recovery."""

    def __init__(self, source: Path, target: Path, result: Recovery) -> None:
        self._target = target
        self._result = result
        self._stored = self._metadata(source)
        self._topics: dict[str, TopicCount] = {}
        self._sequences: dict[str, int] = {}

    def run(self, files: list[Path]) -> None:
        spans: dict[str, TimeSpan] = {}
        expected: list[int | None] = []
        for path in files:
            torn = self._result.damage.torn
            span, stated = self._recover(path)
            expected.append(stated)
            if span.count:
                spans[path.name] = span
                self._result.cut = self._result.damage.torn - torn
        custom = self._stored.custom if self._stored else {}
        write_metadata(self._target, information(list(self._topics.values()), spans, custom))
        if self._stored:
            self._result.expected = self._stored.span.count
        elif None not in expected:
            self._result.expected = sum(count or 0 for count in expected)
        self._result.span = TimeSpan.of(spans.values())

    def _metadata(self, source: Path) -> StoredMetadata | None:
        path = source / METADATA_FILE
        try:
            return read_metadata(path) if path.is_file() else None
        except BagError as error:
            self._result.notes.append(f"{error}; it is written anew")
            return None

    def _recover(self, path: Path) -> tuple[TimeSpan, int | None]:
        """Copy one file; return the times of its messages and the count that its summary states."""
        target = self._target / path.name
        with open_regular(path) as file, target.open("xb") as out:
            if not file.read(len(MAGIC)).startswith(MAGIC):
                self._result.notes.append(f"{path} is no MCAP file, or nothing is left of it")
                span, stated = TimeSpan(), None
            else:
                data = mmap(file.fileno(), 0, access=ACCESS_READ)
                try:
                    span, stated = self._copy(data, path, Copier(out))
                finally:
                    with suppress(BufferError):  # an error's traceback still refers to it
                        data.close()
                out.flush()
                os.fsync(out.fileno())
        if not span.count:
            target.unlink()
        return span, stated

    def _copy(self, data: mmap, path: Path, copier: Copier) -> tuple[TimeSpan, int | None]:
        span, stated, counts = TimeSpan(), None, Counter[str]()
        channels: dict[int, Channel] = {}
        schemas: dict[int, str] = {}
        for record in salvage(data, path, self._result.damage):
            if record.opcode == Opcode.STATISTICS:
                stated = _message_count(record)
            content = self._take(record, copier)
            match content:
                case Schema():
                    schemas.setdefault(content.id, content.name)
                case Channel():
                    channels.setdefault(content.id, content)
                    self._note_topic(content, schemas.get(content.schema_id, ""))
                case Message():
                    topic = channels[content.channel_id].topic
                    counts[topic] += 1
                    span.add(content.log_time)
                    self._count(topic, content.sequence)
        topics = [
            TopicCount(each.name, each.type_name, each.type_hash, each.qos, counts[each.name])
            for each in self._topics.values()
        ]
        damage = self._result.damage
        left_out = {
            "bytes": str(damage.passed_over),
            "torn_messages": str(damage.torn),
            "chunks": str(damage.chunks),
        }
        copier.take(Metadata(name="recover_bag", metadata={"file": path.name} | left_out))
        custom = self._stored.custom if self._stored else {}
        copier.finish({"serialized_metadata": dump(information(topics, {path.name: span}, custom))})
        return span, stated

    def _take(self, record: Record, copier: Copier) -> McapRecord | None:
        """Copy a record; return None where it is not copied or cannot be."""
        try:
            content = parsed(record)
            if content is not None:
                copier.take(content)
        except (McapError, struct.error, ValueError, KeyError):
            self._result.damage.passed_over += len(record.payload)
            return None
        return content

    def _note_topic(self, channel: Channel, type_name: str) -> None:
        if channel.topic not in self._topics:
            qos = parse_qos(channel.metadata.get("offered_qos_profiles", ""))
            self._topics[channel.topic] = TopicCount(
                channel.topic, type_name, channel.metadata.get("topic_type_hash", ""), qos
            )

    def _count(self, topic: str, sequence: int) -> None:
        self._topics[topic].count += 1
        before = self._sequences.get(topic)
        if before is not None and sequence > before + 1:
            self._result.gaps += sequence - before - 1
        self._sequences[topic] = sequence


def _message_count(record: Record) -> int | None:
    """Return the number of messages in a statistics record; None where the record is damaged.

    A damaged record contradicts itself: its counts do not add up.
    """
    with suppress(McapError, struct.error):
        statistics = parse(Statistics, record.payload)
        if statistics.message_count == sum(statistics.channel_message_counts.values()):
            return statistics.message_count
    return None
