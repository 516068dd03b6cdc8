# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Recovery of damaged bags: the rest is kept, losses are counted, the original is not changed."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader

from terrain_estimator.bags import (
    BagError,
    BagReader,
    BagWriter,
    RawMessage,
    Recovery,
    Split,
    recover,
)
from terrain_estimator.bags.reading.records import HEAD
from terrain_estimator.cli.recover_bag import main
from tests.terrain_estimator.bags.support import (
    SLIP,
    TYPES,
    corrupt,
    fill,
    finished_bag,
    killed_recording,
    records,
)

STEPS = 40
TOTAL = 3 * STEPS


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return killed_recording(tmp_path_factory.mktemp("killed") / "run", STEPS)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_bag(tmp_path_factory.mktemp("finished") / "run", STEPS) / "run_0.mcap"


@pytest.fixture(scope="module")
def everything(killed: Path) -> list[RawMessage]:
    return read(killed)


def read(path: Path) -> list[RawMessage]:
    with BagReader(path) as reader:
        return list(reader.messages())


def recovered(file: Path, data: bytes, target: Path) -> tuple[Recovery, list[RawMessage]]:
    """Recover a file of that content; return what is read of the new bag."""
    file.write_bytes(data)
    recovery = recover(file, target)
    assert file.read_bytes() == data, "the original is not touched"
    if not recovery.span.count:
        assert not target.exists()
        return recovery, []
    with BagReader(target) as reader:
        assert reader.finished
        messages = list(reader.messages())
    assert recovery.span.count == len(messages)
    return recovery, messages


def message_records(path: Path) -> list[tuple[int, int]]:
    """Return the first byte of every message of a recording, and the first byte after it."""
    found = [
        (each.offset, each.offset + HEAD.size + len(each.payload))
        for each in records(path)
        if each.opcode == Opcode.MESSAGE
    ]
    assert len(found) == TOTAL
    return found


def test_a_recording_cut_anywhere_is_whole_again_up_to_the_cut(
    killed: Path, everything: list[RawMessage], tmp_path: Path
) -> None:
    data, places = killed.read_bytes(), message_records(killed)
    for index, at in enumerate(
        [*range(places[0][0] - 60, len(data), 997), places[50][1], places[50][1] + 4, len(data)]
    ):
        recovery, messages = recovered(tmp_path / "run.mcap", data[:at], tmp_path / f"cut{index}")
        whole = sum(end <= at for _, end in places)
        assert messages == everything[:whole], f"cut at {at}"
        assert recovery.expected is None
        assert recovery.lost == (
            1 if any(start + HEAD.size <= at < end for start, end in places) else 0
        ), f"cut at {at}"


@pytest.mark.parametrize("opcode", [1, 2, 5, 6])
def test_small_numbers_within_a_cut_message_are_no_record(
    killed: Path, everything: list[RawMessage], tmp_path: Path, opcode: int
) -> None:
    """A count of 1 and zeros are the head of a record without a payload, were there such."""
    data, places = killed.read_bytes(), message_records(killed)
    start, end = places[60]
    looks_like = HEAD.pack(opcode, 0)
    cut = data[: end - 40] + looks_like + bytes(4)
    assert start + HEAD.size < len(cut) < end
    recovery, messages = recovered(tmp_path / "run.mcap", cut, tmp_path / "new")
    assert messages == everything[:60]
    assert recovery.lost == 1


def test_the_new_bag_is_a_bag_for_others(killed: Path, tmp_path: Path) -> None:
    recovery = recover(killed.parent, tmp_path / "new")
    assert (recovery.span.count, recovery.lost, recovery.damage.passed_over) == (TOTAL, 0, 0)
    with AnyReader([tmp_path / "new"]) as reader:
        assert reader.message_count == TOTAL
        assert {connection.topic: connection.msgtype for connection in reader.connections} == TYPES
        assert {
            connection.ext.offered_qos_profiles[0].depth for connection in reader.connections
        } == {50}
    with BagReader(tmp_path / "new") as ours, BagReader(killed) as theirs:
        assert ours.topics == theirs.topics
        assert ours.metadata["recover_bag"]["file"] == "run_0.mcap"


@pytest.mark.parametrize("filling", [b"\0", b"\x05\x01"], ids=["zeros", "what looks like records"])
def test_messages_behind_a_damaged_stretch_are_found(
    killed: Path, everything: list[RawMessage], tmp_path: Path, filling: bytes
) -> None:
    data, places = bytearray(killed.read_bytes()), message_records(killed)
    start, end = places[30][0], places[49][1]
    data[start:end] = (filling * (end - start))[: end - start]
    recovery, messages = recovered(tmp_path / "run.mcap", bytes(data), tmp_path / "new")
    assert messages == everything[:30] + everything[50:]
    assert (recovery.gaps, recovery.lost, recovery.damage.passed_over) == (20, 20, end - start)


def test_a_damaged_length_costs_one_message(
    killed: Path, everything: list[RawMessage], tmp_path: Path
) -> None:
    places = message_records(killed)
    for wrong, length in enumerate([5, 500, 10**6, 2**60]):
        data = bytearray(killed.read_bytes())
        data[places[10][0] + 1 : places[10][0] + HEAD.size] = length.to_bytes(8, "little")
        recovery, messages = recovered(tmp_path / "run.mcap", bytes(data), tmp_path / f"new{wrong}")
        assert [each for each in messages if each in everything] == everything[:10] + everything[
            11:
        ]
        assert recovery.gaps <= 1


def test_a_damaged_chunk_is_left_out_and_its_messages_are_counted(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", recording=True, split=Split(duration_s=1.0)) as writer:
        fill(writer, STEPS)
    corrupt(tmp_path / "run/run_1.mcap", Opcode.CHUNK, at=300)
    with pytest.raises(BagError, match="chunk at byte"):
        read(tmp_path / "run")
    recovery = recover(tmp_path / "run", tmp_path / "new")
    assert (recovery.span.count, recovery.lost, recovery.expected, recovery.damage.chunks) == (
        TOTAL - 30,
        30,
        TOTAL,
        1,
    )
    assert [file.name for file in sorted((tmp_path / "new").glob("*.mcap"))] == [
        "run_0.mcap",
        "run_2.mcap",
        "run_3.mcap",
    ]
    (tmp_path / "run/metadata.yaml").unlink()
    assert recover(tmp_path / "run", tmp_path / "again").lost == 30, "sequence numbers tell it too"


def test_the_parts_of_a_recording_that_a_power_cut_ended_are_recovered(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", recording=True, split=Split(duration_s=1.0))
    fill(writer, STEPS)
    writer.abandon()
    writer.path.write_bytes(writer.path.read_bytes()[:-20])
    (tmp_path / "run/run_4.mcap").touch()
    recovery = recover(tmp_path / "run", tmp_path / "new")
    assert (recovery.span.count, recovery.lost, recovery.damage.torn) == (TOTAL - 1, 1, 1)
    assert "run_4.mcap is no MCAP file, or nothing is left of it" in recovery.notes[0]
    assert len(read(tmp_path / "new")) == TOTAL - 1


def test_a_cut_file_that_others_follow_is_counted_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "terrain_estimator.bags.writing.writer.compact", lambda *_: None
    )  # as a power cut before it leaves the file
    writer = BagWriter(tmp_path / "run", recording=True, split=Split(duration_s=1.0))
    fill(writer, STEPS)
    writer.abandon()
    first = tmp_path / "run/run_0.mcap"
    last_message = [record for record in records(first) if record.opcode == Opcode.MESSAGE][-1]
    first.write_bytes(first.read_bytes()[: last_message.offset + 20])
    recovery = recover(tmp_path / "run", tmp_path / "new")
    assert (
        recovery.span.count,
        recovery.damage.torn,
        recovery.gaps,
        recovery.lost,
        recovery.expected,
    ) == (TOTAL - 1, 1, 1, 1, None)


def test_garbage_in_a_chunk_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_crcs=False)
        writer.start(profile="ros2")
        channel = writer.register_channel(
            "/x", "cdr", writer.register_schema("x/msg/X", "ros2msg", b"uint8 x")
        )
        for number in range(10):
            writer.add_message(channel, number, b"\x07" * 30, number, number)
        writer.finish()
    data = path.read_bytes()
    at = data.index(b"\x07" * 30)
    recovery = recovered(path, data[: at + 30] + b"\xc8" + data[at + 31 :], tmp_path / "new")[
        0
    ]  # an opcode that there is not
    assert (recovery.span.count, recovery.lost) == (9, 1)


@settings(max_examples=50, deadline=None)
@given(
    at=st.floats(0, 1, exclude_max=True),
    length=st.integers(1, 3000),
    byte=st.integers(0, 255),
    use_finished=st.booleans(),
)
def test_no_damage_costs_more_than_what_it_hits(
    tmp_path_factory: pytest.TempPathFactory,
    killed: Path,
    finished: Path,
    at: float,
    length: int,
    byte: int,
    *,
    use_finished: bool,
) -> None:
    source = finished if use_finished else killed
    data = bytearray(source.read_bytes())
    start = int(at * len(data))
    data[start : start + length] = bytes([byte]) * len(data[start : start + length])
    folder = tmp_path_factory.mktemp("damaged")
    recovery, messages = recovered(folder / "run.mcap", bytes(data), folder / "new")
    assert len(messages) <= TOTAL
    if (
        not use_finished and start >= message_records(killed)[0][0]
    ):  # with the descriptions of its topics
        unhurt = [
            each
            for each, place in zip(read(killed), message_records(killed), strict=True)
            if not hits(place, start, length)
        ]
        assert [each for each in messages if each in unhurt] == unhurt
    if recovery.expected is not None:
        assert recovery.expected == TOTAL


def hits(place: tuple[int, int], start: int, length: int) -> bool:
    return start < place[1] and place[0] < start + length


def test_it_says_what_was_recovered_and_lost(
    killed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "run"
    bag.mkdir()
    (bag / "run_0.mcap").write_bytes(killed.read_bytes()[:-20])
    assert main([str(bag)]) == 0
    said = capsys.readouterr().out
    assert (
        f"{tmp_path / 'run_recovered'}: {TOTAL - 1} messages in 3.900 s recovered, 1 lost before"
        " the last one; it is unknown whether more followed" in said
    )
    assert main([str(bag)]) == 2
    assert "run_recovered exists already" in capsys.readouterr().err
    assert main([str(bag), "--replace", "--out", str(tmp_path / "other")]) == 0
    assert "run_damaged" in capsys.readouterr().out
    assert len(read(bag)) == len(read(tmp_path / "run_damaged")) == TOTAL - 1
    with BagReader(bag) as reader:
        assert reader.finished
        assert reader.topics[SLIP].count == STEPS


@pytest.mark.parametrize("content", [b"", b"not a bag", b"\x89MCAP0\r\n", bytes(1000)])
def test_where_nothing_is_left_no_bag_is_made(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.mcap").write_bytes(content)
    assert main([str(tmp_path / "run.mcap")]) == 1
    assert "no message is left" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_what_is_no_bag_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "nowhere")]) == 2
    assert "does not exist" in capsys.readouterr().err
    assert main([str(tmp_path)]) == 2
    assert "is not a bag" in capsys.readouterr().err
    (tmp_path / "run.mcap").touch()
    with pytest.raises(SystemExit):
        main([str(tmp_path / "run.mcap"), "--replace"])
    assert "is not a folder" in capsys.readouterr().err


def test_a_whole_bag_stays_whole(tmp_path: Path) -> None:
    bag = finished_bag(tmp_path / "run")
    recovery = recover(bag, tmp_path / "new")
    assert recovery.words == "60 messages in 1.900 s recovered, none of 60 lost"
    assert read(bag) == read(tmp_path / "new")
    with BagReader(bag) as old, BagReader(tmp_path / "new") as new:
        assert (new.custom, new.metadata["model"]) == (old.custom, old.metadata["model"])
