# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read a bag: a folder of rosbag2 or one of its files, finished or not."""

import heapq
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import accumulate, chain
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from mcap.well_known import MessageEncoding, SchemaEncoding

from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.definitions import Definition, installed_definition, type_hash
from terrain_estimator.bags.format.layout import Layout
from terrain_estimator.bags.format.metadata import (
    METADATA_FILE,
    ROSBAG2_RECORD,
    StoredMetadata,
    TimeSpan,
    read_metadata,
)
from terrain_estimator.bags.format.types import Message, Types
from terrain_estimator.bags.reading.storage import ENDINGS, StorageFile, open_file, plain

LARGEST_COMPARED = 1 << 20
"""[bytes] of definitions that are parsed to compare them with the installed ones, 4 s at most."""


class RawMessage(NamedTuple):
    """A message of a bag, not decoded."""

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes  # CDR with its encapsulation header


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a bag."""

    name: str
    type_name: str
    count: int
    definition: Definition | None  # None where it is not CDR described by .msg source
    qos_text: str  # offered_qos_profiles as stored


class BagReader:
    """Read a bag lazily; use as a context manager.

    Memory grows with a record or chunk, never with the file.

    Raises:
        BagError: there is no bag, or it is empty, cut before its first message, foreign or damaged.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open all files of the bag and read their contents."""
        self.path = Path(path)
        paths, self._stored = _find_files(self.path)
        self._files: list[StorageFile] = []
        self._left_out: list[str] = []
        self._prepared: set[str] = set()
        self.types = Types()
        try:
            self._open(paths)
            self.topics: Mapping[str, TopicInfo] = _merge_topics(self._files)
        except BaseException:
            self.close()
            raise

    @property
    def span(self) -> TimeSpan:
        """Return first and last log time [ns] and the number of messages."""
        return TimeSpan.of(file.contents.span for file in self._files)

    @property
    def finished(self) -> bool:
        """Return whether every file was closed cleanly."""
        return all(file.contents.finished for file in self._files) and not self._left_out

    @property
    def missing_s(self) -> float | None:
        """Time [s] missing at the end: 0 where nothing is missing, None where that is unknown."""
        if self.finished:
            return 0.0
        if self._stored is None or not self._stored.span.count:
            return None
        last = self.span.last_ns if self.span.count else self._stored.span.first_ns
        return max(0.0, (self._stored.span.last_ns - last) / 1e9)

    @property
    def losses(self) -> list[str]:
        """Return what is or may be missing from the bag, one sentence each."""
        return [
            self._unfinished_note(file) for file in self._files if not file.contents.finished
        ] + self._left_out

    @property
    def notes(self) -> list[str]:
        """Return what a user should know about the state of the bag, one sentence each."""
        return (
            self.losses
            + [note for file in self._files for note in file.contents.notes]
            + self.schema_differences()
        )

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the metadata records by name, without rosbag2's own."""
        return {
            record.name: record.metadata
            for file in self._files
            for record in file.contents.metadata
            if record.name != ROSBAG2_RECORD
        }

    @property
    def custom(self) -> dict[str, str]:
        """Return ``custom_data`` of metadata.yaml."""
        return dict(self._stored.custom) if self._stored else {}

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[RawMessage]:
        """Yield messages by log time.

        Args:
            topics: only these; names that the bag lacks are passed over. By default all.
        """
        wanted = frozenset(self.topics if topics is None else topics)
        files = sorted(
            (file for file in self._files if file.contents.span.count),
            key=lambda file: file.contents.span.first_ns,
        )
        streams = [_of_file(file, wanted) for file in files]
        if _overlap(files):
            return heapq.merge(*streams, key=lambda message: message.log_time_ns)
        return chain.from_iterable(streams)

    def decode(self, message: RawMessage) -> Message:
        """Return the message as an object, by the definition that the bag carries.

        Raises:
            BagError: the bag has no definition for it, or the bytes do not fit it.
        """
        if message.topic not in self._prepared:
            self.prepare(message.topic)
        try:
            return self.types.deserialize(message.data, message.type_name)
        except BagError as error:
            msg = (
                f"{self.path}: topic {message.topic} at log time {message.log_time_ns} ns: {error};"
                " leave out this topic or record again"
            )
            raise BagError(msg) from error

    def layout(self, message: RawMessage) -> Layout | None:
        """Return the layout of a message that :meth:`decode` has taken; None where it has none."""
        return self.types.layout(message.data, message.type_name)

    def prepare(self, name: str) -> None:
        """Make a topic's message classes, which takes a few milliseconds.

        :meth:`decode` does it with the first message otherwise.

        Raises:
            BagError: the bag has no definition for it.
        """
        if name in self._prepared:
            return
        definition = self.topics[name].definition
        if definition is None:
            msg = (
                f"{self.path}: topic {name} is not CDR with .msg source, it cannot be decoded;"
                " convert the bag with `ros2 bag convert`"
            )
            raise BagError(msg)
        try:
            self.types.add(definition)
        except BagError as error:
            msg = f"{self.path}: topic {name}: {error}"
            raise BagError(msg) from error
        self._prepared.add(name)

    def expect(self, types: Mapping[str, str]) -> frozenset[str]:
        """Check the types of topics; return those that the bag has.

        Raises:
            BagError: a topic has another type.
        """
        for name, expected in types.items():
            topic = self.topics.get(name)
            if topic is not None and topic.type_name != expected:
                msg = (
                    f"{self.path}: topic {name} is a {topic.type_name}, expected {expected}; remap"
                    " the topic or choose another bag"
                )
                raise BagError(msg)
        return frozenset(name for name in types if name in self.topics)

    def schema_differences(self) -> list[str]:
        """Return a sentence for each type whose fields differ from the installed ones.

        The bag is read by its own definitions.
        """
        definitions = {topic.type_name: topic.definition for topic in self.topics.values()}
        left, differing = LARGEST_COMPARED, []
        for name, definition in definitions.items():
            installed = _installed(name) if definition else None
            if definition is None or installed is None or definition.text == installed.text:
                continue
            left -= len(definition.text)
            if left < 0 or installed.type_hash != _hash(definition):
                differing.append(name)
        return [
            f"{self.path}: {name} was recorded with another definition than the installed one;"
            " fields may be missing"
            for name in differing
        ]

    def close(self) -> None:
        """Close all files."""
        for file in self._files:
            file.close()

    def __enter__(self) -> Self:
        """Return the reader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close all files."""
        self.close()

    def _open(self, paths: list[Path]) -> None:
        for path in paths:
            try:
                self._files.append(open_file(path))
            except BagError as error:
                if self._stored or not self._files or path != paths[-1]:
                    raise
                # a power cut came as this file was begun
                self._left_out.append(f"{error}; this last file of an unfinished bag is left out")

    def _unfinished_note(self, file: StorageFile) -> str:
        start = (
            f"{file.path} ends without a footer (the recorder was killed, or the copy is"
            " incomplete)"
        )
        span = file.contents.span
        if not span.count:
            return f"{start}; it holds no messages"
        missing = self.missing_s
        if missing is None or self._stored is None or file is not self._files[-1]:
            return (
                f"{start}; last message at {span.last_ns / 1e9:.3f} s,"
                f" {span.duration_ns / 1e9:.3f} s after the first"
            )
        return (
            f"{start}; {missing:.3f} s and {self._stored.span.count - self.span.count} messages are"
            " missing at the end"
        )


def bag_name(path: Path) -> str:
    """Return a bag's name: a folder's as it is, dots and all; a bare file's without its ending."""
    path = path.resolve()
    return path.name if path.is_dir() else path.stem


def _find_files(path: Path) -> tuple[list[Path], StoredMetadata | None]:
    if path.is_dir():
        return _files_of_folder(path)
    if not path.exists():
        msg = f"{path} does not exist: give a bag folder or a file of one"
        raise BagError(msg)
    companion = path.parent / METADATA_FILE
    stored = read_metadata(companion) if companion.is_file() else None
    return [path], stored if stored and stored.files == (path.name,) else None


def _files_of_folder(folder: Path) -> tuple[list[Path], StoredMetadata | None]:
    if (folder / METADATA_FILE).is_file():
        stored = read_metadata(folder / METADATA_FILE)
        if missing := [name for name in stored.files if not (folder / name).is_file()]:
            msg = (
                f"{folder}: {METADATA_FILE} lists {', '.join(missing)}, which is not there; copy it"
                " again, or read the other files singly"
            )
            raise BagError(msg)
        return [folder / name for name in stored.files], stored
    return numbered_files(folder, ENDINGS), None


def numbered_files(folder: Path, endings: tuple[str, ...] = (".mcap",)) -> list[Path]:
    """Return the files of a folder with these endings by number; BagError where there are none."""
    names = in_order(file.name for file in folder.iterdir() if file.name.endswith(endings))
    if not names:
        msg = f"{folder} is not a bag: it has neither {METADATA_FILE} nor an .mcap file"
        raise BagError(msg)
    return [folder / name for name in names]


def in_order(names: Iterable[str]) -> list[str]:
    """Return names of a bag's files by number."""
    return sorted(
        names, key=lambda name: (int((re.findall(r"_(\d+)\.\D", name) or ["0"])[-1]), name)
    )


def _merge_topics(files: list[StorageFile]) -> dict[str, TopicInfo]:
    topics: dict[str, TopicInfo] = {}
    counts: Counter[str] = Counter()
    for file in files:
        for channel in file.contents.channels.values():
            schema = file.contents.schemas.get(channel.schema_id)
            type_name = file.contents.type_name(channel)
            known = topics.get(channel.topic)
            if known and known.type_name != type_name:
                msg = (
                    f"{file.path}: topic {channel.topic} is a {known.type_name} and a {type_name};"
                    " split the bag with `ros2 bag convert`"
                )
                raise BagError(msg)
            counts[channel.topic] += file.contents.counts[channel.id]
            definition = None
            if (
                schema
                and schema.encoding == SchemaEncoding.ROS2
                and channel.message_encoding == MessageEncoding.CDR
            ):
                definition = Definition(
                    type_name,
                    schema.data.decode(errors="replace"),
                    channel.metadata.get("topic_type_hash", ""),
                )
            topics[channel.topic] = TopicInfo(
                channel.topic,
                type_name,
                counts[channel.topic],
                definition,
                channel.metadata.get("offered_qos_profiles", ""),
            )
    return topics


def _of_file(file: StorageFile, topics: frozenset[str]) -> Iterator[RawMessage]:
    contents = file.contents
    build = {
        channel.id: partial(RawMessage, channel.topic, contents.type_name(channel))
        for channel in contents.channels.values()
        if channel.topic in topics
    }
    for log_time, channel_id, publish_time, data in file.messages(frozenset(build)):
        yield build[channel_id](log_time, publish_time, plain(data, file.path))


def _overlap(files: list[StorageFile]) -> bool:
    """Return whether files overlap in time, given in the order of their first log times.

    Parts of a split recording rarely do.
    """
    spans = [file.contents.span for file in files]
    ends = accumulate((span.last_ns for span in spans), max)
    return any(span.first_ns < end for span, end in zip(spans[1:], ends, strict=False))


def _installed(type_name: str) -> Definition | None:
    """Return the installed definition, None where there is none."""
    try:
        return installed_definition(type_name)
    except BagError:
        return None


def _hash(definition: Definition) -> str:
    """Return the hash of a definition of the bag, empty where it is damaged."""
    try:
        return type_hash(definition.type_name, definition.text)
    except BagError:
        return ""
