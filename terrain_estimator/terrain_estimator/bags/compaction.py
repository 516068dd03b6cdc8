# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Turn a finished unchunked recording into zstd chunks, so that no moment exists at which the data is not on the disk."""

import os
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from terrain_estimator.bags.metadata import ROSBAG2_RECORD
from terrain_estimator.bags.syncing import sync_folder

TEMPORARY_SUFFIX = ".compacting"


def compact(path: Path) -> None:
    """Replace a finished file by one of the same records in compressed chunks.

    A crash leaves the old file or the new one, and at most a temporary file beside it.

    Raises:
        OSError: no space or no permission; the old file is untouched then.
    """
    temporary = path.with_name(path.name + TEMPORARY_SUFFIX)
    try:
        with path.open("rb") as source, temporary.open("wb") as target:
            _copy(source, target)
            target.flush()
            os.fsync(target.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def _copy(source: BinaryIO, target: BinaryIO) -> None:
    writer = Writer(target, compression=CompressionType.ZSTD)
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    own_metadata: dict[str, str] = {}
    for record in StreamReader(source).records:
        match record:
            case Header():
                writer.start(profile=record.profile)
            case Schema() if record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            case Channel() if record.id not in channels:
                schema = schemas[record.schema_id]
                channels[record.id] = writer.register_channel(record.topic, record.message_encoding, schema, record.metadata)
            case Message():
                channel = channels[record.channel_id]
                writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            case Metadata() if record.name == ROSBAG2_RECORD:
                own_metadata = record.metadata  # a recording has two, the last one is complete
            case Metadata():
                writer.add_metadata(record.name, record.metadata)
    writer.add_metadata(ROSBAG2_RECORD, own_metadata)
    writer.finish()
