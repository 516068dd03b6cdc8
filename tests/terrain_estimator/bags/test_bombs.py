# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Small files that ask for much memory are refused without allocating it."""

import os
import re
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Header, McapRecord, Message, Schema

from terrain_estimator.bags import BagError, BagReader, recover
from terrain_estimator.bags.reading.records import HEAD, LARGEST_CONTENTS, LARGEST_RECORD, MAGIC

PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "zstd": zstandard.compress,
    "lz4": lambda data: lz4.frame.compress(data, store_size=True),
}
READ_WITH_LITTLE = """
import resource, sys
from pathlib import Path
from terrain_estimator.bags import BagError, BagReader

pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
room = pages * resource.getpagesize() + int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_AS, (room, room))
try:
    with BagReader(Path(sys.argv[1])) as reader:
        list(reader.messages())
except BagError as error:
    print(error)
"""
"""Reads a bag with so many bytes of memory beside those of the process, and prints the error."""
UNPACKED = 64_000_000
ALLOWED = 4_000_000
"""[bytes] that the readers themselves may take."""


def built(*contents: McapRecord) -> bytes:
    builder = RecordBuilder()
    for each in contents:
        each.write(builder)
    return builder.end()


def chunk(compression: str, data: bytes, claimed: int) -> Chunk:
    packed = PACKERS[compression](data) if compression else data
    return Chunk(
        compression,
        packed,
        message_end_time=0,
        message_start_time=0,
        uncompressed_crc=0,
        uncompressed_size=claimed,
    )


def topic(data: bytes = b"", log_time: int = 0) -> bytes:
    """Return the contents of a chunk with one message."""
    schema = Schema(id=1, data=b"uint8 x", encoding="ros2msg", name="x/msg/X")
    channel = Channel(id=1, topic="/x", message_encoding="cdr", metadata={}, schema_id=1)
    return built(
        schema,
        channel,
        Message(channel_id=1, log_time=log_time, data=data, publish_time=0, sequence=0),
    )


def bag(path: Path, *chunks: Chunk) -> Path:
    path.write_bytes(MAGIC + built(Header(profile="ros2", library=""), *chunks))
    return path


def read(path: Path) -> int:
    with BagReader(path) as reader:
        return len(list(reader.messages()))


@contextmanager
def little_memory() -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < ALLOWED
    finally:
        tracemalloc.stop()


def spread(path: Path, *parts: tuple[int, bytes]) -> Path:
    """Write a sparse file of a given size with these parts, by their offsets."""
    with path.open("wb") as file:
        for place, part in parts:
            file.seek(place)
            file.write(part)
    return path


@pytest.mark.parametrize(
    ("summary_start", "words"),
    [(30, "its summary begins at byte 30 of 3000000"), (0, "the end of its data is not where")],
)
def test_a_summary_that_would_be_the_whole_file_is_refused(
    summary_start: int, words: str, tmp_path: Path
) -> None:
    head = MAGIC + built(Header(profile="ros2", library=""))
    footer = (
        built(Footer(summary_crc=0, summary_offset_start=0, summary_start=summary_start)) + MAGIC
    )
    path = spread(tmp_path / "large.mcap", (0, head), (3_000_000_000, footer))
    with little_memory(), pytest.raises(BagError, match=rf"large\.mcap is damaged: {words}"):
        read(path)


def test_a_record_above_the_limit_is_passed_over(tmp_path: Path) -> None:
    head = MAGIC + built(Header(profile="ros2", library=""))
    length = LARGEST_RECORD + 1
    path = spread(
        tmp_path / "large.mcap",
        (0, head + HEAD.pack(Opcode.ATTACHMENT, length)),
        (len(head) + HEAD.size + length, topic()),
    )
    with little_memory():
        assert read(path) == 1
        recovery = recover(path, tmp_path / "recovered")
    assert (recovery.span.count, recovery.damage.passed_over) == (1, HEAD.size + length)


@pytest.mark.parametrize("compression", PACKERS)
def test_a_chunk_that_unpacks_to_more_than_it_claims_is_refused(
    compression: str, tmp_path: Path
) -> None:
    bomb = chunk(compression, topic(bytes(UNPACKED)), 1000)
    assert len(bomb.data) < UNPACKED / 200
    whole = bag(tmp_path / "whole.mcap", bomb)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-10])
    with little_memory():
        with pytest.raises(
            BagError,
            match=(
                r"whole\.mcap is damaged: chunk at byte .* more than the 1000 bytes that it claims"
            ),
        ):
            read(whole)
        assert read(cut) == 0
        for path in (whole, cut):
            recovery = recover(path, tmp_path / f"{path.stem}_recovered")
            assert (recovery.span.count, recovery.damage.chunks) == (0, 1)


@pytest.mark.parametrize("compression", ["", *PACKERS])
@pytest.mark.parametrize("wrong", [-1, 1, LARGEST_CONTENTS])
def test_a_claim_has_to_be_right_and_below_the_limit(
    compression: str, wrong: int, tmp_path: Path
) -> None:
    contents = topic(b"1234")
    assert read(bag(tmp_path / "right.mcap", chunk(compression, contents, len(contents)))) == 1
    with pytest.raises(BagError, match=r"bytes that it claims|it claims .* bytes, more than"):
        read(bag(tmp_path / "wrong.mcap", chunk(compression, contents, len(contents) + wrong)))


@pytest.mark.parametrize("compression", PACKERS)
def test_a_chunk_that_the_memory_has_no_room_for_is_an_error_that_names_the_file(
    compression: str, tmp_path: Path
) -> None:
    path = bag(tmp_path / "large.mcap", chunk(compression, topic(), LARGEST_CONTENTS))
    # in a process of its own: this one may hold freed memory that is large enough
    reading = [sys.executable, "-c", READ_WITH_LITTLE, str(path), str(LARGEST_CONTENTS // 8)]
    ended = subprocess.run(reading, capture_output=True, text=True, timeout=60.0, check=False)
    assert ended.returncode == 0, ended.stderr
    assert re.match(r".*large\.mcap: the memory has no room for the chunk at byte", ended.stdout)


def test_chunks_in_chunks_are_passed_over(tmp_path: Path) -> None:
    contents = topic()
    nested = built(chunk("", contents, len(contents)))
    for _ in range(1500):
        nested = built(chunk("", nested, len(nested)))
    both = topic() + nested
    path = bag(tmp_path / "nested.mcap", chunk("", both, len(both)))
    assert read(path) == recover(path, tmp_path / "recovered").span.count == 1


def test_chunks_whose_messages_all_wait_for_each_other_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contents = topic(bytes(900))
    chunks = [chunk("zstd", contents, len(contents))] * 9
    assert read(bag(tmp_path / "few.mcap", *chunks)) == 9
    size = (tmp_path / "few.mcap").stat().st_size
    monkeypatch.setattr("terrain_estimator.bags.reading.mcap_file.LARGEST_WAITING", 9000 - size)
    with pytest.raises(
        BagError,
        match=r"few\.mcap is damaged: more than 9000 bytes of messages are not in the order",
    ):
        read(tmp_path / "few.mcap")


@pytest.mark.parametrize("contents", [bytes(2**26), built(Header("", "")) * 100_000])
def test_many_small_chunks_that_unpack_to_much_take_a_few_seconds(
    contents: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("terrain_estimator.bags.reading.records.MOST_RECORDS", 20_000)
    packed = chunk("zstd", contents, len(contents))
    path = bag(tmp_path / "bombs.mcap", chunk("", topic(), len(topic())), *[packed] * 200)
    assert path.stat().st_size < 200 * 10_000
    started = time.process_time()
    with pytest.raises(BagError, match=r"bombs\.mcap is damaged: .* file of (?:this|its) size"):
        read(path)
    recovery = recover(path, tmp_path / "recovered")
    assert recovery.span.count == 1
    assert recovery.damage.chunks > 100
    assert time.process_time() - started < 10.0


def test_pipes_and_devices_are_refused_at_once(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    os.mkfifo(folder / "run_0.mcap")
    for path in (folder, folder / "run_0.mcap", Path("/dev/zero")):
        with pytest.raises(BagError, match="not a regular file"):
            read(path)
        with pytest.raises((BagError, OSError), match="not a regular file"):
            recover(path, tmp_path / "recovered")
    (folder / "metadata.yaml").symlink_to("/dev/zero")
    with pytest.raises(BagError, match="not a regular file"):
        read(folder)
