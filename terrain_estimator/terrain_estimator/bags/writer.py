# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write a bag: a folder ``NAME/`` with ``NAME_0.mcap`` and ``metadata.yaml``, as rosbag2 and Foxglove open it."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer

from terrain_estimator.bags.compaction import compact
from terrain_estimator.bags.definitions import Definition, installed_definition
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.metadata import ROSBAG2_RECORD, Span, TopicCount, dump, information, sync_folder, write_metadata
from terrain_estimator.bags.qos import Qos, qos_text
from terrain_estimator.bags.syncing import Syncer
from terrain_estimator.bags.types import Message, Types

CHUNK_BYTES = 1024 * 1024


@dataclass(frozen=True, slots=True)
class Topic:
    """Handle of a topic in a bag that is being written."""

    channel_id: int
    count: TopicCount


class BagWriter:
    """Write messages to a new bag folder; use as a context manager.

    Offline (the default) it writes zstd chunks. With ``recording=True`` it writes every message to the operating system
    at once, without chunks, so that a kill loses nothing, and compacts to zstd chunks on a clean close. Leaving the
    context by an exception leaves an unfinished file, which :class:`BagReader` reads, and no metadata.yaml.

    Raises:
        BagError: the folder exists already or cannot be made.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        recording: bool = False,
        sync_interval_s: float = 1.0,
        custom: Mapping[str, str] | None = None,
    ) -> None:
        """Make the folder and start its file.

        Args:
            folder: the bag; must not exist.
            recording: survive a kill.
            sync_interval_s: [s] when recording, what a power cut may cost (time between two fsync).
            custom: goes to ``custom_data`` of metadata.yaml.
        """
        self.folder = Path(folder).absolute()
        self.path = self.folder / f"{self.folder.name}_0.mcap"
        self.types = Types()
        self.span = Span()
        self.compaction_error = ""
        self._recording = recording
        self._custom = dict(custom or {})
        self._topics: dict[str, Topic] = {}
        self._schemas: dict[str, int] = {}
        self._file = self._open()
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, use_chunking=not recording)
        self._writer.start(profile=Profile.ROS2)
        if recording:
            self._writer.add_metadata(ROSBAG2_RECORD, {"serialized_metadata": dump(self._information())})
            self._file.flush()
        self._syncer = Syncer(self._file, sync_interval_s) if recording else None

    @property
    def topics(self) -> Mapping[str, TopicCount]:
        """Return what was written so far, by topic."""
        return {name: topic.count for name, topic in self._topics.items()}

    def add_topic(self, name: str, type_name: str, *, definition: Definition | None = None, qos: tuple[Qos, ...] = (Qos(),)) -> Topic:
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
        metadata = {"offered_qos_profiles": qos_text(qos), "topic_type_hash": definition.type_hash}
        channel = self._writer.register_channel(name, MessageEncoding.CDR, self._schema(definition), metadata)
        topic = Topic(channel, TopicCount(name, type_name, definition.type_hash, qos))
        self._topics[name] = topic
        return topic

    def write(self, topic: Topic, data: bytes, log_time_ns: int, publish_time_ns: int | None = None) -> None:
        """Append a serialised message.

        Args:
            topic: from :meth:`add_topic`.
            data: CDR with its encapsulation header.
            log_time_ns: time of reception [ns]; players go by it.
            publish_time_ns: time of publication [ns], by default the time of reception.

        Raises:
            OSError: the disk is full or broken.
        """
        published = log_time_ns if publish_time_ns is None else publish_time_ns
        self._writer.add_message(topic.channel_id, log_time_ns, data, published, topic.count.count)
        topic.count.count += 1
        self.span.add(log_time_ns)
        if self._syncer:
            self._file.flush()
            self._syncer.check()

    def write_message(self, topic: Topic, message: Message, log_time_ns: int, publish_time_ns: int | None = None) -> None:
        """Serialise and append a message made by ``types.make``."""
        self.write(topic, self.types.serialize(message), log_time_ns, publish_time_ns)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record to the file, for example the hash of a configuration or model."""
        self._writer.add_metadata(name, dict(values))
        if self._recording:
            self._file.flush()

    def close(self) -> None:
        """Finish the file, write metadata.yaml and, when recording, compact.

        The bag is complete before compaction starts, so nothing is lost if that fails (``compaction_error`` says why).
        """
        if self._file.closed:
            return
        fields = self._information()
        self._writer.add_metadata(ROSBAG2_RECORD, {"serialized_metadata": dump(fields)})
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self.abandon()
        write_metadata(self.folder, fields)
        if self._recording:  # the bag is whole already
            try:
                compact(self.path)
            except OSError as error:
                self.compaction_error = f"{self.path} stays uncompressed: {error}"

    def abandon(self) -> None:
        """Close the file as it is, without footer and metadata.yaml, as a kill would leave it."""
        if self._syncer:
            self._syncer.stop()
        self._file.close()

    def __enter__(self) -> Self:
        """Return the writer itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Finish the bag, or leave it unfinished after an exception."""
        if kind is None:
            self.close()
        else:
            self.abandon()

    def _open(self) -> BinaryIO:
        try:
            self.folder.mkdir(parents=True)
            file = self.path.open("xb")
        except FileExistsError as error:
            msg = f"{self.folder} exists already: choose another name, bags are never overwritten"
            raise BagError(msg) from error
        except OSError as error:
            msg = f"cannot write a bag to {self.folder}: {error.strerror}; choose a folder that you may write"
            raise BagError(msg) from error
        sync_folder(self.folder)
        return file

    def _schema(self, definition: Definition) -> int:
        name = definition.type_name
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, SchemaEncoding.ROS2, definition.text.encode())
        return self._schemas[name]

    def _information(self) -> dict[str, object]:
        return information([topic.count for topic in self._topics.values()], self.span, self.path.name, self._custom)
