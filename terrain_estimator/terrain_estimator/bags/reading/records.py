# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Records of one MCAP file: a scan that stops at a cut, and the contents of chunks.

Source: MCAP file format, version 0. The mcap package's readers refuse an unfinished file or return
a shortened last record without an error. The scan here checks every length instead.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol, TypeVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk

from terrain_estimator.bags.errors import BagError

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode, length
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel id, sequence, log time [ns], publish time [ns]
LARGEST_RECORD = 2**30  # bytes; a damaged length must not ask for all memory
# [bytes] that a chunk unpacks to, fifty times what writers use; also the limit of a summary
LARGEST_CONTENTS = 2**26
LARGEST_RATIO = 100
"""Largest sum of unpacked bytes of a file, in its own size, beyond one chunk of the largest."""
MOST_RECORDS = 500_000
"""Records in the chunks of a file beyond one for every two bytes of it."""


class Record(NamedTuple):
    """One record of a file."""

    opcode: int
    payload: bytes
    offset: int  # of its first byte in the file
    whole: bool  # False: the file ends within it


class StoredMessage(NamedTuple):
    """A message as stored, sortable by log time."""

    log_time_ns: int
    channel_id: int
    publish_time_ns: int
    data: bytes


T_co = TypeVar("T_co", covariant=True)


class Parsed(Protocol[T_co]):
    """A record class of the mcap package."""

    @staticmethod
    def read(stream: ReadDataStream) -> T_co:
        """Parse a payload."""


def scan(file: BinaryIO, start: int, end: int) -> Iterator[Record]:
    """Yield the records between two offsets; the last one may not be whole.

    Stops at opcode 0 too: after a power cut a file may end in zeros.
    """
    while found := _record_at(file, start, end):
        record, start = found
        yield record


def first_record(file: BinaryIO, start: int, end: int) -> Record | None:
    """Return the first record between two offsets, which may not be whole; None without one."""
    found = _record_at(file, start, end)
    return found[0] if found else None


def _record_at(file: BinaryIO, offset: int, end: int) -> tuple[Record, int] | None:
    """Return a record and the offset behind it."""
    if offset + HEAD.size > end:
        return None
    file.seek(offset)  # every time: several scans may share the file
    opcode, length = HEAD.unpack(file.read(HEAD.size))
    if opcode == 0:
        return None
    room = end - offset - HEAD.size
    whole = length <= min(room, LARGEST_RECORD)
    useful = length if whole else min(room, LARGEST_RECORD) if opcode == Opcode.CHUNK else 0
    return Record(opcode, file.read(useful), offset, whole), offset + HEAD.size + length


def parse(kind: Parsed[T_co], payload: bytes) -> T_co:
    """Parse a whole record's payload with a record class of the mcap package.

    Raises:
        McapError: a length in it is beyond what Python can read at once, 2^63 bytes.
        struct.error, UnicodeDecodeError: it is too short, or a text in it is not UTF-8.
    """
    try:
        return kind.read(ReadDataStream(BytesIO(payload)))
    except OverflowError as error:
        raise McapError("a length in it is beyond 2^63 bytes") from error


class Unpacker:
    """Unpack the chunks of one file once, within limits for all of them together.

    Without them a file of 1 MB could hold a thousand chunks that unpack to 64 MiB each, or an index
    that names one of them a thousand times.
    """

    def __init__(self, path: Path, size: int) -> None:
        """Begin a pass over a file of ``size`` [bytes]."""
        self._path = path
        self._bytes = LARGEST_CONTENTS + LARGEST_RATIO * size
        self._records = MOST_RECORDS + size // 2

    def contents(self, record: Record) -> bytes:
        """Return the uncompressed records of a chunk. Raises BagError as :func:`chunk_contents`."""
        data = chunk_contents(record, self._path, min(self._bytes, LARGEST_CONTENTS))
        self._bytes -= len(data)
        return data

    def records(self, record: Record) -> Iterator[Record]:
        """Yield the records of a chunk; the last one may not be whole. Raises BagError."""
        for inner in records_in(self.contents(record), record.offset):
            self._records -= 1
            if self._records < 0:
                raise BagError(
                    f"{self._path} is damaged: its chunks hold more records than a file of its size"
                    " can have; copy the file again from its source"
                )
            yield inner


def chunk_contents(record: Record, path: Path, most: int = LARGEST_CONTENTS) -> bytes:
    """Return the uncompressed records of a chunk, at most so many bytes.

    If the end of the file cuts the chunk, the result holds the records that are left.

    Raises:
        BagError: a whole chunk is damaged, its compression is unknown, or the memory is too small
            for it.
    """
    try:
        chunk = parse(Chunk, record.payload)
        data = _decompress(chunk, most, whole=record.whole)
    except MemoryError as error:
        msg = (
            f"{path}: the memory has no room for the chunk at byte {record.offset}; read it on a"
            " machine with more"
        )
        raise BagError(msg) from error
    except (
        zstandard.ZstdError,
        McapError,
        struct.error,
        RuntimeError,
        ValueError,
        OSError,
    ) as error:
        if not record.whole:
            return b""
        msg = (
            f"{path} is damaged: chunk at byte {record.offset} does not decompress ({error}); copy"
            " the file again from its source"
        )
        raise BagError(msg) from error
    if record.whole and chunk.uncompressed_crc not in {0, zlib.crc32(data)}:
        msg = (
            f"{path} is damaged: chunk at byte {record.offset} has a wrong checksum; copy the file"
            " again from its source"
        )
        raise BagError(msg)
    return data


def records_in(data: bytes, offset: int = 0) -> Iterator[Record]:
    """Yield the records in a chunk's contents; the last one may not be whole.

    ``offset`` is where the chunk begins in its file.
    """
    position = 0
    while position + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, position)
        if opcode == 0:
            return
        payload = data[position + HEAD.size : position + HEAD.size + length]
        yield Record(opcode, payload, offset, len(payload) == length)
        position += HEAD.size + length


def messages_in(data: bytes, wanted: frozenset[int]) -> Iterator[StoredMessage]:
    """Yield the whole messages of wanted channels in the contents of a chunk."""
    position, end, size = 0, len(data), HEAD.size + MESSAGE_HEAD.size
    while position + HEAD.size <= end:
        opcode, length = HEAD.unpack_from(data, position)
        following = position + HEAD.size + length
        if opcode == Opcode.MESSAGE and following <= end:
            channel, _, log_time, publish_time = MESSAGE_HEAD.unpack_from(
                data, position + HEAD.size
            )
            if channel in wanted:
                yield StoredMessage(
                    log_time, channel, publish_time, data[position + size : following]
                )
        position = following


def message_of(payload: bytes) -> StoredMessage:
    """Return the message in a message record's payload."""
    channel, _, log_time, publish_time = MESSAGE_HEAD.unpack_from(payload)
    return StoredMessage(log_time, channel, publish_time, payload[MESSAGE_HEAD.size :])


def _decompress(chunk: Chunk, most: int, *, whole: bool) -> bytes:
    """Return the contents, unpacked at most one byte beyond the size that the chunk claims.

    Without this limit a few bytes could unpack to gigabytes.
    """
    claimed = chunk.uncompressed_size
    if claimed > most:
        msg = f"it claims {claimed} bytes, more than {most} for a file of this size"
        raise ValueError(msg)
    match chunk.compression:
        case "":
            data = chunk.data
        case "zstd":
            data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(claimed + 1)
        case "lz4":
            data = bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, claimed + 1))
        case other:
            msg = f"compression {other!r} is unknown"
            raise ValueError(msg)
    if len(data) > claimed or (whole and len(data) < claimed):
        msg = (
            f"it unpacks to {'more' if len(data) > claimed else 'less'} than the {claimed} bytes"
            " that it claims"
        )
        raise ValueError(msg)
    return data
