# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Find the records of a damaged MCAP file.

This includes records behind a damaged stretch, and the rest of a chunk that the end of the file
cuts.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from mmap import mmap
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.reading.records import (
    HEAD,
    LARGEST_RECORD,
    MAGIC,
    MESSAGE_HEAD,
    Record,
    Unpacker,
    parse,
)

_LARGEST_OPCODE = max(Opcode)
_HEAD_LIKE = re.compile(rb"(?=[\x01-\x0f].{4}\x00{4})", re.DOTALL)
"""Pattern of a record's opcode and length below 4 GiB; random bytes match once in 70 GB."""
_LINKS = 3  # records in a row that confirm the beginning of the first
_KINDS = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}


_SHORTEST = 4
_LEAST = {Opcode.HEADER: 8, Opcode.FOOTER: 20, Opcode.MESSAGE: MESSAGE_HEAD.size, Opcode.CHUNK: 40}
"""[bytes] Least payload of a record, from the fixed parts of the MCAP specification.

Small numbers within a message look like records of no length.
"""


@dataclass(slots=True)
class Damage:
    """Unreadable parts of a file."""

    passed_over: int = 0  # bytes
    torn: int = 0  # messages that the end of the file cuts
    chunks: int = 0


def salvage(data: mmap, path: Path, damage: Damage) -> Iterator[Record]:
    """Yield the whole records of a file, with chunks replaced by the records in them.

    Updates ``damage`` on the way.
    """
    unpacker = Unpacker(path, len(data))
    for record in _records(data, damage):
        if record.opcode != Opcode.CHUNK:
            yield record
            continue
        damage.chunks += not record.whole
        try:
            for inner in unpacker.records(record):
                if inner.whole:
                    yield inner
                elif inner.opcode == Opcode.MESSAGE:
                    damage.torn += 1
        except BagError:
            damage.chunks += record.whole
            damage.passed_over += len(record.payload)


def parsed(record: Record) -> McapRecord | None:
    """Parse a record with mcap's class; None for a kind that a copy writes anew.

    Raises whatever a damaged payload makes mcap raise.
    """
    if record.opcode == Opcode.MESSAGE:
        channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(record.payload)
        return Message(
            channel, log_time, record.payload[MESSAGE_HEAD.size :], publish_time, sequence
        )
    kind = _KINDS.get(Opcode(record.opcode))
    return parse(kind, record.payload) if kind else None  # type: ignore[arg-type]


def _records(data: mmap, damage: Damage) -> Iterator[Record]:
    end = len(data) - (len(MAGIC) if data[-len(MAGIC) :] == MAGIC else 0)
    offset = len(MAGIC)
    while offset + HEAD.size <= end:
        opcode, length = HEAD.unpack_from(data, offset)
        following = offset + HEAD.size + length
        fits = 1 <= opcode <= _LARGEST_OPCODE and following <= end
        followed = fits and (following == end or _begins(data, following, end))
        found = following if followed else _next(data, offset + 1, end)
        if fits and found >= following:  # else its length is wrong: a record begins within it
            if length > LARGEST_RECORD:
                damage.passed_over += following - offset
                offset = following
                continue
            yield Record(opcode, data[offset + HEAD.size : following], offset, whole=True)
            offset = following
            continue
        if found == end and opcode == Opcode.CHUNK:
            yield Record(
                opcode,
                data[offset + HEAD.size : min(end, offset + HEAD.size + LARGEST_RECORD)],
                offset,
                whole=False,
            )
        else:
            damage.passed_over += found - offset
            damage.torn += found == end and opcode == Opcode.MESSAGE
        offset = found


def _next(data: mmap, start: int, end: int) -> int:
    """Return the offset of the next record; ``end`` where there is none."""
    return next(
        (
            match.start()
            for match in _HEAD_LIKE.finditer(data, start, end)
            if _begins(data, match.start(), end)
        ),
        end,
    )


def _begins(data: mmap, at: int, end: int) -> bool:
    """Return whether a whole record begins here, followed by others or by the end of the file."""
    for link in range(_LINKS):
        if at == end:
            return link > 0
        if at + HEAD.size > end:
            return link > 0
        opcode, length = HEAD.unpack_from(data, at)
        if not 1 <= opcode <= _LARGEST_OPCODE or length < _LEAST.get(opcode, _SHORTEST):
            return False
        at += HEAD.size + length
        if at > end:
            return link > 0
    return True
