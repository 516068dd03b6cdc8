# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A long recording in several files is one run for every reader, and each file is whole."""

import threading
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from terrain_estimator.bags import BagError, BagReader, BagWriter, Split
from terrain_estimator.bags.writing import writer
from tests.terrain_estimator.bags.support import ODOM, SLIP, STEP_NS, TYPES, fill

STEPS = 50


def split_recording(folder: Path, split: Split) -> BagWriter:
    bag = BagWriter(folder, recording=True, split=split, metadata={"recorder": {"seed": "7"}})
    fill(bag, STEPS)
    return bag


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"))


def steps_of(folder: Path) -> list[int]:
    with BagReader(folder) as reader:
        return [reader.decode(message).sequence for message in reader.messages([SLIP])]


@pytest.mark.parametrize(
    "split", [Split(duration_s=1.2), Split(size=15_000)], ids=["duration", "size"]
)
def test_the_files_are_one_run_for_every_reader(tmp_path: Path, split: Split) -> None:
    folder = tmp_path / "run"
    split_recording(folder, split).close()
    names = [file.name for file in files(folder)]
    assert names == [f"run_{index}.mcap" for index in range(len(names))]
    assert len(names) >= 4
    assert steps_of(folder) == list(range(STEPS))
    fields = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert fields["relative_file_paths"] == [file["path"] for file in fields["files"]] == names
    assert (
        sum(file["message_count"] for file in fields["files"])
        == fields["message_count"]
        == 3 * STEPS
    )
    starts = [file["starting_time"]["nanoseconds_since_epoch"] for file in fields["files"]]
    assert starts == sorted(starts)
    assert fields["duration"]["nanoseconds"] == (STEPS - 1) * STEP_NS
    with AnyReader([folder]) as others:
        assert others.message_count == 3 * STEPS
        assert [time for connection, time, _ in others.messages() if connection.topic == ODOM] == [
            (k + 1) * STEP_NS for k in range(STEPS)
        ]
    decoded = []
    for file in files(folder):
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            decoded += [
                entry.decoded_message.sequence
                for entry in reader.iter_decoded_messages(topics=[SLIP])
            ]
            own = [
                record.metadata for record in reader.iter_metadata() if record.name == "recorder"
            ]
        assert own == [{"seed": "7"}]
    assert decoded == list(range(STEPS))


def test_a_span_of_log_times_ends_a_file(tmp_path: Path) -> None:
    split_recording(tmp_path / "run", Split(duration_s=1.2)).close()
    for file in files(tmp_path / "run"):
        with BagReader(file) as reader:
            assert reader.span.duration_ns < 1.2e9
            assert set(reader.topics) == set(TYPES)


def test_a_topic_that_appears_late_is_in_the_files_from_then_on(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", recording=True, split=Split(duration_s=0.5)) as bag:
        data = bag.types.serialize(bag.types.make(TYPES[SLIP]))
        early = bag.add_topic("/early", TYPES[SLIP])
        for step in range(10):
            bag.write(early, data, step * STEP_NS)
        late = bag.add_topic("/late", TYPES[SLIP])
        for step in range(10, 20):
            bag.write(late, data, step * STEP_NS)
    with BagReader(tmp_path / "run") as reader:
        assert {name: topic.count for name, topic in reader.topics.items()} == {
            "/early": 10,
            "/late": 10,
        }


def test_a_kill_leaves_whole_files_and_one_without_a_footer(tmp_path: Path) -> None:
    split_recording(tmp_path / "run", Split(duration_s=1.2)).abandon()
    assert steps_of(tmp_path / "run") == list(range(STEPS))
    with BagReader(tmp_path / "run") as reader:
        [note] = reader.notes
    assert f"{files(tmp_path / 'run')[-1]} ends without a footer" in note


@pytest.mark.parametrize("content", [b"", bytes(4096)], ids=["empty", "zeros"])
def test_a_last_file_that_a_power_cut_left_empty_does_not_hide_the_others(
    tmp_path: Path, content: bytes
) -> None:
    split_recording(tmp_path / "run", Split(duration_s=1.2)).abandon()
    (tmp_path / "run/run_5.mcap").write_bytes(content)
    assert steps_of(tmp_path / "run") == list(range(STEPS))
    with BagReader(tmp_path / "run") as reader:
        assert not reader.finished
        assert "this last file of an unfinished bag is left out" in reader.notes[1]


def test_a_disk_that_is_full_at_a_split_keeps_all_files_and_leaves_no_empty_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = BagWriter(tmp_path / "run", recording=True, split=Split(duration_s=0.5))
    topic = bag.add_topic("/slip", TYPES[SLIP])
    data = bag.types.serialize(bag.types.make(TYPES[SLIP]))
    for step in range(5):
        bag.write(topic, data, step * STEP_NS)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("terrain_estimator.bags.writing.part.BagPart.add_topic", full)
    with pytest.raises(OSError, match="No space left"):
        bag.write(topic, data, 5 * STEP_NS)
    bag.abandon()
    assert [file.name for file in files(tmp_path / "run")] == ["run_0.mcap"]
    with BagReader(tmp_path / "run") as reader:
        assert (reader.finished, reader.span.count) == (True, 5)


def test_compressing_a_file_does_not_hold_up_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on = threading.Event()

    def slow(path: Path, _: object) -> None:
        assert go_on.wait(20.0)
        raise ValueError(f"whatever happens to {path}")

    monkeypatch.setattr(writer, "compact", slow)
    bag = split_recording(
        tmp_path / "run", Split(duration_s=1.2)
    )  # returns although nothing can be compressed yet
    assert bag.span.count == 3 * STEPS
    go_on.set()
    bag.close()
    assert bag.compaction_error.count("stays uncompressed") == len(files(tmp_path / "run"))
    assert steps_of(tmp_path / "run") == list(range(STEPS))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match=r"cannot write a bag to .*file/run: Not a directory"):
        BagWriter(tmp_path / "file/run")


def test_a_bag_that_cannot_be_begun_leaves_nothing_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("terrain_estimator.bags.writing.part.BagPart.add_metadata", full)
        with pytest.raises(BagError, match=r"cannot write a bag to .*: No space left on device"):
            BagWriter(tmp_path / "run", recording=True, metadata={"recorder": {}})
    BagWriter(tmp_path / "run", recording=True, metadata={"recorder": {}}).close()
