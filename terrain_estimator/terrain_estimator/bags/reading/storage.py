# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Open a file of a bag by its content: MCAP or SQLite, compressed by rosbag2 or not."""

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import zstandard

from rover_parameters.regular_file import open_regular
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.reading import sqlite_file
from terrain_estimator.bags.reading.contents import Contents
from terrain_estimator.bags.reading.mcap_file import McapFile
from terrain_estimator.bags.reading.records import LARGEST_CONTENTS, StoredMessage
from terrain_estimator.bags.reading.sqlite_file import SqliteFile

ENDINGS = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a zstd frame; no message in CDR begins like this."""
_LEAST = 64 << 20
_HIGHEST_RATIO = 100
_BLOCK = 1 << 20
_LONGEST_WINDOW = 1 << 27


class StorageFile(Protocol):
    """A file of a bag, in the terms of MCAP."""

    path: Path
    contents: Contents

    def messages(self, wanted: frozenset[int]) -> Iterator[StoredMessage]:
        """Yield the messages of the wanted channels by log time."""

    def close(self) -> None:
        """Close the file."""


def open_file(path: Path) -> StorageFile:
    """Open a file of a bag. Raises BagError where it cannot be read."""
    if not _head(path).startswith(ZSTD):
        return _open_plain(path)
    with tempfile.TemporaryDirectory(prefix="bag_") as folder:
        unpacked = Path(folder) / path.stem
        _unpack(path, unpacked)
        if _head(unpacked).startswith(ZSTD):
            raise BagError(f"{path} is compressed twice: unpack it once with `zstd -d`")
        try:
            file = _open_plain(unpacked)
        except BagError as error:
            raise BagError(str(error).replace(str(unpacked), str(path))) from error
    # the open file outlives its name
    file.path = path
    return file


def plain(data: bytes, path: Path) -> bytes:
    """Return a message's CDR bytes, unpacked where rosbag2 compressed each message.

    Raises:
        BagError: it is damaged, or unpacks to more than a chunk of an MCAP file may.
    """
    if not data.startswith(ZSTD):
        return data
    try:
        reader = zstandard.ZstdDecompressor(max_window_size=_LONGEST_WINDOW).stream_reader(data)
        parts = [reader.read(_BLOCK)]
        size = len(parts[0])
        while parts[-1] and size <= LARGEST_CONTENTS:
            parts.append(reader.read(_BLOCK))
            size += len(parts[-1])
        claimed = zstandard.frame_content_size(data)
    except zstandard.ZstdError as error:
        raise BagError(f"{path} is damaged: a message does not decompress ({error})") from error
    if size > LARGEST_CONTENTS or claimed not in {-1, size}:
        raise BagError(
            f"{path} is damaged: a message of {len(data)} bytes unpacks to {size} bytes or more,"
            f" and claims {claimed}; copy the file again from its source"
        )
    return b"".join(parts)


def _open_plain(path: Path) -> StorageFile:
    sqlite = _head(path).startswith(sqlite_file.MAGIC)
    return SqliteFile(path) if sqlite else McapFile(path)


def _head(path: Path) -> bytes:
    try:
        with open_regular(path) as file:
            return file.read(len(sqlite_file.MAGIC))
    except OSError as error:
        raise BagError(f"cannot read {path}: {error.strerror}") from error


def _unpack(path: Path, target: Path) -> None:
    """Unpack a file; a few bytes that unpack to gigabytes are refused.

    Raises BagError.
    """
    packed = path.stat().st_size
    limit = min(max(_LEAST, _HIGHEST_RATIO * packed), shutil.disk_usage(target.parent).free)
    size = 0
    try:
        with open_regular(path) as file, target.open("xb") as out:
            claimed = zstandard.frame_content_size(file.read(18))  # longest header of a frame
            file.seek(0)
            decompressor = zstandard.ZstdDecompressor(max_window_size=_LONGEST_WINDOW)
            with decompressor.stream_reader(file, read_across_frames=True) as reader:
                while size <= limit and (block := reader.read(_BLOCK)):
                    size += out.write(block)
    except (zstandard.ZstdError, OSError) as error:
        raise BagError(
            f"{path} cannot be unpacked to {target.parent} ({error}): copy it again from its"
            " source, or set TMPDIR to a folder with room"
        ) from error
    if size > limit:
        raise BagError(
            f"{path}: its {packed} bytes unpack to more than {limit}: too much for a recording, or"
            f" for {target.parent} (TMPDIR names another folder); unpack it with `zstd -d`"
        )
    if 0 <= size < claimed:
        raise BagError(
            f"{path} is cut: {size} of {claimed} bytes unpack; copy it again from its source"
        )
