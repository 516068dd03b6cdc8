# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read one MCAP file of a bag: its contents, and its messages in the order of their log times."""

import struct
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterator
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.well_known import Profile

from rover_parameters.regular_file import open_regular
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.metadata import TimeSpan
from terrain_estimator.bags.reading.contents import Contents
from terrain_estimator.bags.reading.records import (
    HEAD,
    LARGEST_CONTENTS,
    MAGIC,
    Record,
    StoredMessage,
    Unpacker,
    first_record,
    message_of,
    messages_in,
    parse,
    scan,
)

FOOTER_BYTES = HEAD.size + 20 + len(MAGIC)
LARGEST_WAITING = 2**26
"""[bytes] of messages that wait to be sorted, beyond the size of the file."""
WINDOW = 1024  # messages; a file without chunk index is sorted within this window
_OBJECT_BYTES = 200  # memory of a message in addition to its data
_LOG_TIME: Callable[[StoredMessage], int] = itemgetter(0)
_FOREIGN = {
    b"#ROSBAG V": "a ROS 1 bag: convert it with `rosbags-convert`",
}


class McapFile:
    """An open MCAP file of profile ros2, finished or not.

    Raises:
        BagError: empty, not MCAP, another profile, or damaged.
    """

    def __init__(self, path: Path) -> None:
        """Open the file and read its summary, or scan it where it has none."""
        self.path = path
        self.contents = Contents(finished=False)
        self._chunks: list[ChunkIndex] = []
        try:
            self._file: BinaryIO = open_regular(path)
        except OSError as error:
            msg = f"cannot read {path}: {error.strerror}"
            raise BagError(msg) from error
        try:
            self._read_contents()
        except (McapError, struct.error, UnicodeDecodeError) as error:
            self.close()
            msg = (
                f"{path} is damaged ({type(error).__name__}: {error}); copy the file again from its"
                " source"
            )
            raise BagError(msg) from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def messages(self, wanted: frozenset[int]) -> Iterator[StoredMessage]:
        """Yield the messages of the wanted channels by log time.

        A file without chunk index (a recording that was not compacted) is read in its own order and
        sorted within ``WINDOW`` messages, so that memory does not grow with the file.
        """
        return self._by_chunk_index(wanted) if self._chunks else self._by_scan(wanted)

    def _read_contents(self) -> None:
        self._end = self._file.seek(0, 2)
        self._check_head()
        summary_start = self._summary_start()
        if summary_start and self._read_summary(summary_start):
            return
        unpacker = Unpacker(self.path, self._end)
        for record in self._data_records():
            self._note(record, unpacker)
        self._chunks = []

    def _check_head(self) -> None:
        self._file.seek(0)
        head = self._file.read(len(MAGIC) + 1)
        if not head:
            msg = (
                f"{self.path} is empty (0 bytes): the recorder stopped before it wrote anything, or"
                " the copy failed"
            )
            raise BagError(msg)
        if not head.startswith(MAGIC):
            kind = next(
                (text for start, text in _FOREIGN.items() if head.startswith(start)),
                "not an MCAP file: give a bag of ROS 2",
            )
            if MAGIC.startswith(head):
                kind = f"cut after {len(head)} bytes, before its first record: copy it again"
            msg = f"{self.path} is {kind}"
            raise BagError(msg)
        first = first_record(self._file, len(MAGIC), self._end)
        if first is None or not first.whole:
            msg = (
                f"{self.path} is cut within its header after {self._end} bytes: it holds no"
                " messages, copy it again"
            )
            raise BagError(msg)
        profile = (
            parse(Header, first.payload).profile if first.opcode == Opcode.HEADER else "(no header)"
        )
        if profile != Profile.ROS2:
            msg = (
                f"{self.path} has MCAP profile {profile!r}, not 'ros2': only bags of ROS 2 can be"
                " read"
            )
            raise BagError(msg)

    def _summary_start(self) -> int:
        """Find the footer; return where the summary starts, 0 where there is none."""
        if self._end < len(MAGIC) + FOOTER_BYTES:
            return 0
        self._file.seek(self._end - FOOTER_BYTES)
        tail = self._file.read(FOOTER_BYTES)
        opcode, length = HEAD.unpack_from(tail)
        if (opcode, length) != (Opcode.FOOTER, 20) or not tail.endswith(MAGIC):
            return 0
        self.contents.finished = True
        footer = parse(Footer, tail[HEAD.size :])
        if not footer.summary_start:
            return 0
        if not 0 <= self._end - FOOTER_BYTES - footer.summary_start <= LARGEST_CONTENTS:
            place = f"byte {footer.summary_start} of {self._end}"
            msg = (
                f"{self.path} is damaged: its summary begins at {place}; copy the file again from"
                " its source"
            )
            raise BagError(msg)
        self._file.seek(footer.summary_start)
        summary = self._file.read(self._end - FOOTER_BYTES - footer.summary_start)
        checked = zlib.crc32(tail[: -4 - len(MAGIC)], zlib.crc32(summary))
        if footer.summary_crc not in {0, checked}:
            msg = (
                f"{self.path} is damaged: its summary has a wrong checksum; copy the file again"
                " from its source"
            )
            raise BagError(msg)
        return footer.summary_start

    def _read_summary(self, start: int) -> bool:
        """Read the summary; return whether it is complete."""
        statistics: Statistics | None = None
        unpacker = Unpacker(self.path, self._end)
        for record in scan(self._file, start, self._end - FOOTER_BYTES):
            match record.opcode:
                case Opcode.STATISTICS:
                    statistics = parse(Statistics, record.payload)
                case Opcode.CHUNK_INDEX:
                    self._chunks.append(parse(ChunkIndex, record.payload))
                case Opcode.METADATA_INDEX:
                    self._read_metadata(parse(MetadataIndex, record.payload))
                case _:
                    self._note(record, unpacker)
        if (
            statistics is None
            or len(self.contents.channels) != statistics.channel_count
            or len(self._chunks) != statistics.chunk_count
        ):
            return False
        self.contents.counts.update(statistics.channel_message_counts)
        if statistics.message_count:
            self.contents.span = TimeSpan(
                statistics.message_start_time, statistics.message_end_time, statistics.message_count
            )
        self._chunks.sort(key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset))
        return True

    def _read_metadata(self, index: MetadataIndex) -> None:
        record = first_record(self._file, index.offset, index.offset + index.length)
        if record is not None and record.whole and record.opcode == Opcode.METADATA:
            self.contents.metadata.append(parse(Metadata, record.payload))

    def _note(self, record: Record, unpacker: Unpacker) -> None:
        """Register a record of the data section: a schema, channel, metadata record or message."""
        match record.opcode:
            case Opcode.CHUNK:
                for inner in unpacker.records(record):
                    # no chunk may hold a chunk: their nesting could have no end
                    if inner.opcode != Opcode.CHUNK:
                        self._note(inner, unpacker)
            case _ if not record.whole:
                return
            case Opcode.SCHEMA:
                schema = parse(Schema, record.payload)
                self.contents.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = parse(Channel, record.payload)
                self.contents.channels[channel.id] = channel
            case Opcode.METADATA:
                self.contents.metadata.append(parse(Metadata, record.payload))
            case Opcode.MESSAGE:
                self._count(message_of(record.payload))

    def _count(self, message: StoredMessage) -> None:
        if message.channel_id not in self.contents.channels:
            msg = (
                f"{self.path} is damaged: a message of channel {message.channel_id}, which is not"
                " described; copy the file again"
            )
            raise BagError(msg)
        self.contents.counts[message.channel_id] += 1
        self.contents.span.add(message.log_time_ns)

    def _data_records(self) -> Iterator[Record]:
        for record in scan(self._file, len(MAGIC), self._end):
            if record.opcode == Opcode.DATA_END:
                return
            yield record
        if self.contents.finished:
            msg = (
                f"{self.path} is damaged: the end of its data is not where it should be; copy the"
                " file again from its source"
            )
            raise BagError(msg)

    def _by_chunk_index(self, wanted: frozenset[int]) -> Iterator[StoredMessage]:
        waiting: list[StoredMessage] = []
        unpacker = Unpacker(self.path, self._end)
        relevant = [
            chunk
            for chunk in self._chunks
            if not chunk.message_index_offsets or not wanted.isdisjoint(chunk.message_index_offsets)
        ]
        for index, chunk in enumerate(relevant):
            record = first_record(
                self._file, chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length
            )
            if record is None or record.opcode != Opcode.CHUNK or not record.whole:
                msg = (
                    f"{self.path} is damaged: no chunk at byte {chunk.chunk_start_offset}; copy the"
                    " file again from its source"
                )
                raise BagError(msg)
            waiting.extend(messages_in(unpacker.contents(record), wanted))
            self._check_waiting(waiting)
            waiting.sort(key=_LOG_TIME)
            following = (
                relevant[index + 1].message_start_time
                if index + 1 < len(relevant)
                else waiting[-1].log_time_ns
                if waiting
                else 0
            )
            ready = bisect_right(waiting, following, key=_LOG_TIME)
            yield from waiting[:ready]
            del waiting[:ready]

    def _by_scan(self, wanted: frozenset[int]) -> Iterator[StoredMessage]:
        waiting: list[StoredMessage] = []
        unpacker = Unpacker(self.path, self._end)
        for record in self._data_records():
            if record.opcode == Opcode.CHUNK:
                waiting.extend(messages_in(unpacker.contents(record), wanted))
                self._check_waiting(waiting)
            elif record.opcode == Opcode.MESSAGE and record.whole:
                message = message_of(record.payload)
                if message.channel_id in wanted:
                    waiting.append(message)
            if len(waiting) >= 2 * WINDOW:
                waiting.sort(key=_LOG_TIME)
                yield from waiting[:-WINDOW]
                del waiting[:-WINDOW]
        waiting.sort(key=_LOG_TIME)
        yield from waiting

    def _check_waiting(self, waiting: list[StoredMessage]) -> None:
        """Refuse to hold more than ``LARGEST_WAITING`` beyond the size of the file.

        Small chunks can unpack to large ones that all share one time, and then no message may be
        released before the last one is read.
        """
        most = LARGEST_WAITING + self._end
        if sum(_OBJECT_BYTES + len(message.data) for message in waiting) > most:
            size = f"more than {most} bytes of messages are not in the order of their log times"
            msg = (
                f"{self.path} is damaged: {size}; copy the file again from its source, or write it"
                " anew with `ros2 bag convert`"
            )
            raise BagError(msg)
