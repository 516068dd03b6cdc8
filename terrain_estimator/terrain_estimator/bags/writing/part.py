# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write one MCAP file of a bag."""

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer

from terrain_estimator.bags.format.definitions import Definition
from terrain_estimator.bags.format.metadata import (
    ROSBAG2_RECORD,
    TimeSpan,
    TopicCount,
    dump,
    information,
)
from terrain_estimator.bags.format.qos import qos_text
from terrain_estimator.bags.writing.syncing import Syncer, sync_folder

CHUNK_BYTES = 1024 * 1024


@dataclass(frozen=True, slots=True)
class BagTopic:
    """Handle of a topic in a bag that is being written."""

    count: TopicCount
    definition: Definition


class BagPart:
    """A new file: in zstd chunks or, when recording, without chunks and synced at intervals.

    Raises:
        OSError: the disk is full or broken; here and in every method that does not state otherwise.
    """

    def __init__(
        self, path: Path, custom: Mapping[str, str], sync_interval_s: float | None
    ) -> None:
        """Begin the file; ``sync_interval_s`` is None unless it is a recording."""
        self.path = path
        self.span = TimeSpan()
        self._custom = dict(custom)
        self._recording = sync_interval_s is not None
        self._channels: dict[str, int] = {}
        self._counts: dict[str, TopicCount] = {}
        self._schemas: dict[str, int] = {}
        self._file: BinaryIO = path.open("xb")
        self._syncer: Syncer | None = None
        try:
            chunks = not self._recording
            self._writer = Writer(
                self._file,
                chunk_size=CHUNK_BYTES,
                compression=CompressionType.ZSTD,
                use_chunking=chunks,
            )
            self._writer.start(profile=Profile.ROS2)
            if self._recording:
                self._add_own_metadata()
                self._file.flush()
        except BaseException:
            self.discard()
            raise
        if sync_interval_s is not None:
            self._syncer = Syncer(self._file, path.parent, sync_interval_s)

    @property
    def size(self) -> int:
        """Number of bytes written so far."""
        return self._file.tell()

    @property
    def late_s(self) -> float:
        """Time [s] by which the last sync is late: a power cut now costs this much more."""
        return self._syncer.late_s if self._syncer and not self._file.closed else 0.0

    def add_topic(self, topic: BagTopic) -> None:
        """Register a topic."""
        count, definition = topic.count, topic.definition
        metadata = {"offered_qos_profiles": qos_text(count.qos), "topic_type_hash": count.type_hash}
        channel = self._writer.register_channel(
            count.name, MessageEncoding.CDR, self._schema(definition), metadata
        )
        self._channels[count.name], self._counts[count.name] = channel, replace(count, count=0)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._writer.add_metadata(name, dict(values))
        if self._recording:
            self._file.flush()

    def write(self, topic: BagTopic, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Append a message of a registered topic; its sequence number is the topic's count."""
        name = topic.count.name
        self._writer.add_message(
            self._channels[name], log_time_ns, data, publish_time_ns, topic.count.count
        )
        self._counts[name].count += 1
        self.span.add(log_time_ns)
        if self._syncer:
            self._file.flush()
            self._syncer.check()

    def finish(self) -> None:
        """Write the summary and the footer; no message can be added afterwards."""
        self._add_own_metadata()
        self._writer.finish()
        self._file.flush()

    def settle(self) -> None:
        """Sync a finished file to the disk, and close it."""
        os.fsync(self._file.fileno())
        sync_folder(self.path.parent)
        self._close()
        if self._syncer:
            self._syncer.check()  # an error that one fsync reports is forgotten by the next

    def abandon(self) -> None:
        """Close the file as it is, with whatever the disk accepts; never raises."""
        if not self._file.closed:
            with suppress(OSError):
                os.fsync(self._file.fileno())
            with suppress(OSError):
                self._close()

    def discard(self) -> None:
        """Remove a file that could not be begun."""
        with suppress(OSError):
            self._close()
        self.path.unlink(missing_ok=True)

    def _close(self) -> None:
        if self._syncer:
            self._syncer.stop()
        with suppress(InterruptedError):  # Linux has closed the file all the same
            self._file.close()

    def _schema(self, definition: Definition) -> int:
        name = definition.type_name
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(
                name, SchemaEncoding.ROS2, definition.text.encode()
            )
        return self._schemas[name]

    def _add_own_metadata(self) -> None:
        """Add rosbag2's record for each file: metadata.yaml as if the bag had no other file."""
        fields = information(list(self._counts.values()), {self.path.name: self.span}, self._custom)
        self._writer.add_metadata(ROSBAG2_RECORD, {"serialized_metadata": dump(fields)})
