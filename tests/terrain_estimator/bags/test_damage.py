# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Unfinished, damaged and foreign files: readable parts are read, the rest is a clear error."""

import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import Writer

from terrain_estimator.bags import BagError, BagReader, BagWriter, Definition, RawMessage
from tests.terrain_estimator.bags.support import (
    SLIP,
    STEP_NS,
    TYPES,
    corrupt,
    fill,
    finished_bag,
    killed_recording,
    records,
)


def read(path: Path) -> list[RawMessage]:
    with BagReader(path) as reader:
        return list(reader.messages())


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_bag(tmp_path_factory.mktemp("finished") / "run", 40) / "run_0.mcap"


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return killed_recording(tmp_path_factory.mktemp("killed") / "run", 40)


def cut(path: Path, size: int, target: Path) -> Path:
    target.write_bytes(path.read_bytes()[:size])
    return target


def test_a_killed_recording_is_read_to_its_end(killed: Path) -> None:
    with BagReader(killed.parent) as reader:
        assert len(list(reader.messages())) == 120
        assert not reader.finished
        assert reader.missing_s is None
        [note] = reader.notes
    assert f"{killed} ends without a footer" in note
    assert "last message at 4.000 s, 3.900 s after the first" in note


def test_a_recording_cut_anywhere_keeps_every_whole_message(killed: Path, tmp_path: Path) -> None:
    ends = [
        record.offset + 9 + len(record.payload)
        for record in records(killed)
        if record.opcode == Opcode.MESSAGE
    ]
    everything = read(killed)
    first_record_end = records(killed)[0].offset + 9 + len(records(killed)[0].payload)
    size = killed.stat().st_size
    for at in [*range(size - 400, size), *range(first_record_end, size, 397), *ends[::9]]:
        whole = sum(end <= at for end in ends)
        assert read(cut(killed, at, tmp_path / "cut.mcap")) == everything[:whole], f"cut at {at}"


def test_a_finished_file_cut_anywhere_is_read_as_far_as_it_goes(
    finished: Path, tmp_path: Path
) -> None:
    everything = read(finished)
    size = finished.stat().st_size
    chunk = next(record for record in records(finished) if record.opcode == Opcode.CHUNK)
    for at in [*range(chunk.offset, size, 31), *range(size - 40, size)]:
        messages = read(cut(finished, at, tmp_path / "cut.mcap"))
        assert messages == everything[: len(messages)], f"cut at {at}"
        if at >= chunk.offset + 9 + len(chunk.payload):
            assert len(messages) == len(everything), f"cut at {at}"


def test_what_is_left_of_a_cut_chunk_is_read(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as writer:
        fill(writer, 1500)
    [chunk, *_] = [record for record in records(writer.path) if record.opcode == Opcode.CHUNK]
    messages = read(
        cut(writer.path, chunk.offset + 9 + len(chunk.payload) - 10, tmp_path / "cut.mcap")
    )
    assert len(messages) > 300


@pytest.mark.parametrize("folder", [True, False], ids=["folder", "file"])
def test_metadata_yaml_tells_how_many_seconds_are_missing(tmp_path: Path, *, folder: bool) -> None:
    writer = BagWriter(tmp_path / "run", recording=True)
    fill(writer, 100)
    whole = writer.path.read_bytes()
    writer.close()
    writer.path.write_bytes(whole[: len(whole) // 2])
    with BagReader(writer.folder if folder else writer.path) as reader:
        assert reader.missing_s is not None
        assert reader.missing_s == pytest.approx((100 * STEP_NS - reader.span.last_ns) / 1e9)
        assert 1.0 < reader.missing_s < 9.0
        [note] = reader.notes
    assert f"{reader.missing_s:.3f} s and {300 - reader.span.count} messages are missing" in note


def test_zeros_at_the_end_of_a_recording_are_passed_over(killed: Path, tmp_path: Path) -> None:
    padded = tmp_path / "padded.mcap"
    padded.write_bytes(killed.read_bytes() + bytes(4096))
    assert read(padded) == read(killed)


def read_or_error(path: Path) -> tuple[int, str]:
    """Decode all messages; return their number, and the error that ended it."""
    count = 0
    try:
        with BagReader(path) as reader:
            assert isinstance(reader.notes, list)
            for message in reader.messages():
                reader.decode(message)
                count += 1
    except BagError as error:
        return count, str(error)
    return count, ""


@given(
    fraction=st.floats(0, 1, exclude_max=True), flip=st.integers(1, 255), recording=st.booleans()
)
def test_one_wrong_byte_never_crashes_the_reader(
    finished: Path, killed: Path, fraction: float, flip: int, *, recording: bool
) -> None:
    source = killed if recording else finished
    data = bytearray(source.read_bytes())
    data[int(fraction * len(data))] ^= flip
    damaged = source.parent.parent / "damaged.mcap"
    damaged.write_bytes(data)
    count, error = read_or_error(damaged)
    assert count <= 120
    assert not error or str(damaged) in error


@pytest.mark.parametrize(
    ("opcode", "at", "words"),
    [
        (Opcode.CHUNK, 300, "chunk at byte"),
        (Opcode.STATISTICS, 3, "its summary has a wrong checksum"),
        (Opcode.CHUNK_INDEX, 20, "its summary has a wrong checksum"),
        (Opcode.FOOTER, 0, "its summary has a wrong checksum"),
        (Opcode.HEADER, 4, "is damaged .UnicodeDecodeError"),
    ],
)
def test_a_damaged_record_is_named(
    finished: Path, tmp_path: Path, opcode: Opcode, at: int, words: str
) -> None:
    damaged = Path(shutil.copy(finished, tmp_path / "damaged.mcap"))
    corrupt(damaged, opcode, at=at)
    with pytest.raises(BagError, match=words) as caught:
        read(damaged)
    assert str(damaged) in str(caught.value)


def test_a_length_beyond_all_memory_is_named(finished: Path, tmp_path: Path) -> None:
    damaged = Path(shutil.copy(finished, tmp_path / "damaged.mcap"))
    chunk = next(record for record in records(damaged) if record.opcode == Opcode.CHUNK)
    # a chunk: start, end, size [8 bytes each], checksum [4], compression [4 and its text], length
    at = 28 + 4 + int.from_bytes(chunk.payload[28:32], "little")
    corrupt(damaged, Opcode.CHUNK, at=at + 7)  # the highest byte of the length: 2^63 and more
    with pytest.raises(BagError, match=r"chunk at byte .* beyond 2\^63 bytes") as caught:
        read(damaged)
    assert str(damaged) in str(caught.value)


def test_the_damage_helper_fails_where_there_is_nothing_to_damage(finished: Path) -> None:
    with pytest.raises(AssertionError, match="nothing to corrupt"):
        corrupt(finished, Opcode.ATTACHMENT)


def write_foreign(path: Path, profile: str) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=profile)
        writer.finish()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", r"is empty \(0 bytes\)"),
        (b"\x89MCA", "is cut after 4 bytes"),
        (b"\x89MCAP0\r\n", "is cut within its header"),
        (b"\x89MCAP0\r\n\x01\x20\x00\x00\x00\x00\x00\x00\x00ros2", "is cut within its header"),
        (b"#ROSBAG V2.0\n", "is a ROS 1 bag: convert it"),
        (b"SQLite format 3\0", "is damaged .*copy the file again"),
        (b"time,slip\n0,0.1\n", "is not an MCAP file"),
    ],
)
def test_a_foreign_or_empty_file_is_named(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "foreign.mcap"
    path.write_bytes(content)
    with pytest.raises(BagError, match=words) as caught:
        BagReader(path)
    assert str(path) in str(caught.value)


def test_another_profile_is_refused(tmp_path: Path) -> None:
    write_foreign(tmp_path / "foreign.mcap", "ros1")
    with pytest.raises(BagError, match="has MCAP profile 'ros1', not 'ros2'"):
        BagReader(tmp_path / "foreign.mcap")


def test_a_path_without_a_bag_is_named(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="does not exist: give a bag folder"):
        BagReader(tmp_path / "nothing")
    with pytest.raises(BagError, match="is not a bag: it has neither"):
        BagReader(tmp_path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is damaged"),
        ("rosbag2_bagfile_information: {version: 9", "is damaged"),
        ("rosbag2_bagfile_information: {version: 9}", "is damaged .*storage_identifier"),
    ],
)
def test_a_damaged_metadata_yaml_is_named(tmp_path: Path, text: str, words: str) -> None:
    folder = finished_bag(tmp_path / "run")
    (folder / "metadata.yaml").write_text(text)
    with pytest.raises(BagError, match=words) as caught:
        BagReader(folder)
    assert "delete it to read the .mcap files" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new"), [("mcap\n", "other\n"), ("compression_mode: ''", "compression_mode: CHUNK")]
)
def test_another_storage_is_refused(tmp_path: Path, old: str, new: str) -> None:
    folder = finished_bag(tmp_path / "run")
    text = (folder / "metadata.yaml").read_text()
    assert old in text
    (folder / "metadata.yaml").write_text(text.replace(old, new))
    with pytest.raises(BagError, match="is not supported; convert it"):
        BagReader(folder)


def test_a_listed_file_that_is_gone_is_named(tmp_path: Path) -> None:
    folder = finished_bag(tmp_path / "run")
    (folder / "run_0.mcap").unlink()
    with pytest.raises(BagError, match=r"lists run_0\.mcap, which is not there"):
        BagReader(folder)


def test_a_topic_of_another_type_is_named(finished: Path) -> None:
    with BagReader(finished) as reader:
        assert reader.expect({SLIP: TYPES[SLIP], "/missing": "x/msg/Y"}) == {SLIP}
        with pytest.raises(
            BagError,
            match="topic /wheel_slip is a msg_defs/msg/WheelSlip, expected nav_msgs/msg/Odometry",
        ):
            reader.expect({SLIP: "nav_msgs/msg/Odometry"})


def test_bytes_that_are_not_the_message_are_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as writer:
        writer.write(writer.add_topic(SLIP, TYPES[SLIP]), b"\x00\x01\x00\x00short", 5)
    with BagReader(tmp_path / "run") as reader:
        [message] = reader.messages()
        with pytest.raises(
            BagError,
            match="topic /wheel_slip at log time 5 ns: 9 bytes are not a msg_defs/msg/WheelSlip",
        ):
            reader.decode(message)


def test_a_definition_that_contains_itself_is_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as writer:
        writer.write(
            writer.add_topic("/x", "x/msg/A", definition=Definition("x/msg/A", "A inner\n", "")),
            b"\x00\x01\x00\x00",
            5,
        )
    with BagReader(tmp_path / "run") as reader:
        assert reader.notes == []
        [message] = reader.messages()
        with pytest.raises(BagError, match="topic /x: the definition of x/msg/A contains itself"):
            reader.decode(message)


def test_a_bag_is_never_overwritten(tmp_path: Path) -> None:
    finished_bag(tmp_path / "run")
    with pytest.raises(BagError, match="exists already: choose another name"):
        BagWriter(tmp_path / "run")


def test_a_type_that_is_not_installed_is_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as writer:
        with pytest.raises(BagError, match="package nowhere_msgs is not installed"):
            writer.add_topic("/x", "nowhere_msgs/msg/Thing")
        with pytest.raises(BagError, match="'Thing' is not a message type"):
            writer.add_topic("/x", "Thing")
        with pytest.raises(BagError, match=r"Nothing\.msg does not exist"):
            writer.add_topic("/x", "msg_defs/msg/Nothing")


def test_leaving_by_an_exception_leaves_an_unfinished_bag(tmp_path: Path) -> None:
    def interrupted() -> None:
        with BagWriter(tmp_path / "run") as writer:
            fill(writer, 5)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not (tmp_path / "run" / "metadata.yaml").exists()
    with BagReader(tmp_path / "run") as reader:
        assert not reader.finished
