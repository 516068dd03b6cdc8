# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Copy records into a new MCAP file of compressed chunks."""

from typing import BinaryIO

from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.well_known import Profile
from mcap.writer import CompressionType, Writer

from terrain_estimator.bags.format.metadata import ROSBAG2_RECORD


class Copier:
    """Copy the records of a file one by one.

    Schemas and channels that are repeated, as in a summary, are skipped.
    """

    def __init__(self, target: BinaryIO) -> None:
        """Begin the file."""
        self._writer = Writer(target, compression=CompressionType.ZSTD)
        self._writer.start(profile=Profile.ROS2)
        self._schemas: dict[int, int] = {0: 0}  # a channel without schema names 0
        self._channels: dict[int, int] = {}
        self._own_metadata: dict[str, str] = {}

    def take(self, record: McapRecord) -> None:
        """Copy a record; KeyError where a message or channel comes before what it refers to."""
        match record:
            case Schema() if record.id not in self._schemas:
                self._schemas[record.id] = self._writer.register_schema(
                    record.name, record.encoding, record.data
                )
            case Channel() if record.id not in self._channels:
                schema = self._schemas[record.schema_id]
                self._channels[record.id] = self._writer.register_channel(
                    record.topic, record.message_encoding, schema, record.metadata
                )
            case Message():
                channel = self._channels[record.channel_id]
                self._writer.add_message(
                    channel, record.log_time, record.data, record.publish_time, record.sequence
                )
            case Metadata() if record.name == ROSBAG2_RECORD:
                # a recording has two, the last one is complete
                self._own_metadata = record.metadata
            case Metadata():
                self._writer.add_metadata(record.name, record.metadata)
            case Attachment():
                self._writer.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )

    def finish(self, own_metadata: dict[str, str] | None = None) -> None:
        """Finish the file; ``own_metadata`` replaces rosbag2's own copy of metadata.yaml."""
        self._writer.add_metadata(
            ROSBAG2_RECORD, self._own_metadata if own_metadata is None else own_metadata
        )
        self._writer.finish()
