# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write a bag as rosbag2 and Foxglove open it.

A bag is a folder ``NAME/`` with ``NAME_0.mcap`` and ``metadata.yaml``.
"""

import math
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from terrain_estimator.bags.errors import BagError, BagExistsError
from terrain_estimator.bags.format.definitions import Definition, installed_definition
from terrain_estimator.bags.format.metadata import TimeSpan, TopicCount, information, write_metadata
from terrain_estimator.bags.format.qos import Qos
from terrain_estimator.bags.format.types import Message, Types
from terrain_estimator.bags.writing.compaction import compact
from terrain_estimator.bags.writing.part import BagPart, BagTopic
from terrain_estimator.bags.writing.syncing import sync_folder
from terrain_estimator.files.atomic import discard
from terrain_estimator.files.worker import Worker

UNSETTLED = 100
"""Finished files that may wait for the disk.

Each holds a descriptor and a thread. Beyond this number the current file is continued.
"""


@dataclass(frozen=True, slots=True)
class Split:
    """Limits at which the next file of a bag begins."""

    size: float = math.inf  # [bytes] of a file, before it is compressed
    duration_s: float = math.inf  # [s] of log time

    def due(self, part: BagPart, log_time_ns: int) -> bool:
        """Return whether a message of that time goes into the next file; an empty one is kept."""
        if not part.span.count:
            return False
        return part.size >= self.size or log_time_ns - part.span.first_ns >= self.duration_s * 1e9


class BagWriter:
    """Write messages to a new bag folder; use as a context manager.

    Offline (the default) it writes zstd chunks. With ``recording=True`` it writes every message to
    the operating system at once, without chunks, so that a kill loses nothing, and compacts a file
    to zstd chunks when it is complete: those that a split leaves behind in a thread, the last one
    on a clean close. Leaving the context by an exception leaves an unfinished file, which
    :class:`BagReader` reads, and no metadata.yaml.

    Raises:
        BagExistsError: the folder exists already.
        BagError: it cannot be made.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        recording: bool = False,
        sync_interval_s: float = 1.0,
        split: Split | None = None,
        custom: Mapping[str, str] | None = None,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        """Make the folder and start its file.

        Args:
            folder: the bag; must not exist.
            recording: survive a kill of the process.
            sync_interval_s: [s] when recording, what a power cut may cost (time between two fsync).
            split: where the next file begins; by default everything goes to one file.
            custom: stored as ``custom_data`` of metadata.yaml.
            metadata: records for every file, as by :meth:`add_metadata`.
        """
        self.folder = Path(folder).absolute()
        self.types = Types()
        self.sync_interval_s = sync_interval_s
        self._recording = recording
        self._split = split or Split()
        self._custom = dict(custom or {})
        self._topics: dict[str, BagTopic] = {}
        self._metadata = list((metadata or {}).items())
        self._spans: dict[str, TimeSpan] = {}  # of all files, by name
        self._uncompressed: list[str] = []
        self._settler = Worker("settle")
        self._settling: list[tuple[BagPart, Future[None]]] = []
        self._closed = False
        self.whole = False  # finished, but for its compression
        self._make_folder()
        try:
            self._part = self._new_part()
        except BaseException as error:
            discard(self.folder)
            if isinstance(error, OSError):
                raise _cannot_write(self.folder, error) from error
            raise

    @property
    def path(self) -> Path:
        """Path of the file that is being written."""
        return self._part.path

    @property
    def span(self) -> TimeSpan:
        """First and last log time [ns] and the number of messages so far."""
        return TimeSpan.of(self._spans.values())

    @property
    def topics(self) -> Mapping[str, TopicCount]:
        """Messages written so far, by topic."""
        return {name: topic.count for name, topic in self._topics.items()}

    @property
    def late_s(self) -> float:
        """Time [s] by which the oldest due sync is late: a power cut now costs this much more."""
        return max(part.late_s for part in (self._part, *(part for part, _ in self._settling)))

    @property
    def moved_s(self) -> float:
        """Steady time [s] of the last progress in syncing and compressing files."""
        return self._settler.moved_s

    @property
    def compaction_error(self) -> str:
        """Files that could not be compressed, with the reasons; empty where there are none."""
        return "; ".join(self._uncompressed)

    def add_topic(
        self,
        name: str,
        type_name: str,
        *,
        definition: Definition | None = None,
        qos: tuple[Qos, ...] = (Qos(),),
    ) -> BagTopic:
        """Register a topic.

        Args:
            name: absolute name of the topic.
            type_name: ``pkg/msg/Name``.
            definition: from an input bag; by default that of the sourced workspace.
            qos: what the publishers offer.

        Raises:
            BagError: the topic is there already, or the type is not installed.
        """
        if name in self._topics:
            msg = f"{self.path}: topic {name} was added twice"
            raise BagError(msg)
        definition = definition or installed_definition(type_name)
        topic = BagTopic(TopicCount(name, type_name, definition.type_hash, qos), definition)
        self._part.add_topic(topic)
        self._topics[name] = topic
        return topic

    def write(
        self, topic: BagTopic, data: bytes, log_time_ns: int, publish_time_ns: int | None = None
    ) -> None:
        """Append a serialised message.

        Args:
            topic: from :meth:`add_topic`.
            data: CDR with its encapsulation header.
            log_time_ns: time of reception [ns], the time that players use.
            publish_time_ns: time of sending [ns]; that of reception where it is not given.

        Raises:
            OSError: the disk is full or broken.
        """
        if len(self._settling) < UNSETTLED and self._split.due(self._part, log_time_ns):
            self._next_part()
        self._part.write(
            topic, data, log_time_ns, log_time_ns if publish_time_ns is None else publish_time_ns
        )
        topic.count.count += 1
        while self._settling and self._settling[0][1].done():
            self._settling.pop(0)[1].result()

    def write_message(
        self,
        topic: BagTopic,
        message: Message,
        log_time_ns: int,
        publish_time_ns: int | None = None,
    ) -> None:
        """Serialise and append a message made by ``types.make``."""
        self.write(topic, self.types.serialize(message), log_time_ns, publish_time_ns)

    def add_metadata(self, name: str, values: Mapping[str, str], *, once: bool = False) -> None:
        """Add a metadata record to this file and, unless it is there ``once``, all that follow."""
        self._part.add_metadata(name, values)
        if not once:
            self._metadata.append((name, values))

    def close(self) -> None:
        """Finish the last file, write metadata.yaml and, when recording, compact.

        The bag is complete before that compaction starts, so nothing is lost if it fails (see
        ``compaction_error``).
        """
        if self._closed:
            return
        self._part.finish()
        self._part.settle()
        self._settler.move()
        for _, settled in self._settling:
            settled.result()
        write_metadata(
            self.folder,
            information(
                [topic.count for topic in self._topics.values()], self._spans, self._custom
            ),
        )
        self.whole = True
        self._compact(self._part)
        self._settler.end()
        self._closed = True

    def abandon(self) -> None:
        """Close the files without metadata.yaml, as a kill would leave them; never raises."""
        self._closed = True
        for _, settled in self._settling:
            if not settled.cancel():
                settled.exception()  # waits
        self._settler.end()
        for part in (self._part, *(part for part, _ in self._settling)):
            part.abandon()

    def discard(self) -> None:
        """Delete the bag with all that was written; never raises."""
        self.abandon()
        discard(self.folder)

    def __enter__(self) -> Self:
        """Return the writer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the bag, or leave it unfinished after an exception."""
        if kind is None:
            self.close()
        else:
            self.abandon()

    def _new_part(self) -> BagPart:
        """Begin a file that can be read alone, except for messages that were sent only once."""
        path = self.folder / f"{self.folder.name}_{len(self._spans)}.mcap"
        part = BagPart(path, self._custom, self.sync_interval_s if self._recording else None)
        try:
            for topic in self._topics.values():
                part.add_topic(topic)
            for name, values in self._metadata:
                part.add_metadata(name, values)
        except BaseException:
            part.discard()
            raise
        self._spans[path.name] = part.span
        return part

    def _next_part(self) -> None:
        """Begin the next file, and leave the fsync and compaction of this one to a thread.

        Both can take long. Until they are done, the file is synced at intervals as before.
        """
        self._part.finish()
        done, self._part = self._part, self._new_part()
        self._settling.append((done, self._settler.give(partial(self._settle, done))))

    def _settle(self, part: BagPart) -> None:
        part.settle()
        self._compact(part)

    def _compact(self, part: BagPart) -> None:
        if not self._recording:
            return
        try:
            compact(part.path, self._settler.move)
        except Exception as error:  # noqa: BLE001 - the file is whole without its compaction
            self._uncompressed.append(f"{part.path} stays uncompressed: {error}")

    def _make_folder(self) -> None:
        made = [folder for folder in (self.folder, *self.folder.parents) if not folder.exists()]
        try:
            self.folder.mkdir(parents=True)
            try:
                for folder in made:
                    sync_folder(folder.parent)
            except BaseException:
                self.folder.rmdir()
                raise
        except FileExistsError as error:
            msg = f"{self.folder} exists already: choose another name, bags are never overwritten"
            raise BagExistsError(msg) from error
        except OSError as error:
            raise _cannot_write(self.folder, error) from error


@contextmanager
def whole_bag(folder: str | os.PathLike[str]) -> Iterator[BagWriter]:
    """Write a bag to its end, or remove it after an exception.

    Half a run could be mistaken for a whole one, and would block its name.

    Raises as :class:`BagWriter` does, and OSError where the disk is full.
    """
    writer = BagWriter(folder)
    try:
        yield writer
        writer.close()  # a full disk may show only here
    except BaseException:
        writer.discard()
        raise


def _cannot_write(folder: Path, error: OSError) -> BagError:
    return BagError(
        f"cannot write a bag to {folder}: {error.strerror}; choose a folder that you may write, on"
        " a disk with room"
    )
