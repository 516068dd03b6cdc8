# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that we write are read again, by us and by others."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from terrain_estimator.bags import STATE, BagError, BagReader, BagWriter, Qos
from tests.terrain_estimator.bags.support import (
    ODOM,
    SINKAGE,
    SLIP,
    STEP_NS,
    TYPES,
    WHEELS,
    fill,
    finished_bag,
)

# Keys of BagMetadata, TopicMetadata and FileInformation in rosbag2_storage/yaml.hpp of ROS 2 Jazzy.
BAG_KEYS = {
    "version",
    "storage_identifier",
    "duration",
    "starting_time",
    "message_count",
    "topics_with_message_count",
    "compression_format",
    "compression_mode",
    "relative_file_paths",
    "files",
    "custom_data",
    "ros_distro",
}
TOPIC_KEYS = {
    "name",
    "type",
    "serialization_format",
    "offered_qos_profiles",
    "type_description_hash",
}
FILE_KEYS = {"path", "starting_time", "duration", "message_count"}
QOS_KEYS = {
    "history",
    "depth",
    "reliability",
    "durability",
    "deadline",
    "lifespan",
    "liveliness",
    "liveliness_lease_duration",
    "avoid_ros_namespace_conventions",
}


def metadata_of(folder: Path) -> dict[str, object]:
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


@pytest.mark.parametrize("recording", [False, True], ids=["offline", "recorded"])
def test_every_message_comes_back_in_order_with_its_times(
    tmp_path: Path, *, recording: bool
) -> None:
    with BagWriter(tmp_path / "run", recording=recording) as writer:
        fill(writer, 30)
    with BagReader(tmp_path / "run") as reader:
        messages = list(reader.messages())
        slips = [reader.decode(message) for message in messages if message.topic == SLIP]
    assert [message.topic for message in messages] == [SLIP, SINKAGE, ODOM] * 30
    assert [message.type_name for message in messages[:3]] == list(TYPES.values())
    assert [message.log_time_ns for message in messages[::3]] == [
        (step + 1) * STEP_NS for step in range(30)
    ]
    assert all(message.publish_time_ns == message.log_time_ns - 1000 for message in messages)
    assert [slip.sequence for slip in slips] == list(range(30))
    assert slips[12].wheel == WHEELS
    np.testing.assert_array_equal(slips[12].slip, [0.012] * 4)


def test_a_finished_bag_says_what_is_in_it(tmp_path: Path) -> None:
    with BagReader(finished_bag(tmp_path / "run")) as reader:
        assert reader.finished
        assert reader.missing_s == 0.0
        assert reader.notes == []
        assert {name: (topic.type_name, topic.count) for name, topic in reader.topics.items()} == {
            name: (kind, 20) for name, kind in TYPES.items()
        }
        assert (reader.span.first_ns, reader.span.last_ns, reader.span.count) == (
            STEP_NS,
            20 * STEP_NS,
            60,
        )
        assert reader.metadata == {"model": {"sha256": "abc"}}
        assert reader.custom == {"seed": "7"}


def test_a_bare_file_reads_like_its_folder(tmp_path: Path) -> None:
    folder = finished_bag(tmp_path / "run")
    with BagReader(folder) as whole, BagReader(folder / "run_0.mcap") as bare:
        assert list(whole.messages()) == list(bare.messages())


def test_only_wanted_topics_are_read(tmp_path: Path) -> None:
    with BagReader(finished_bag(tmp_path / "run")) as reader:
        assert {message.topic for message in reader.messages([ODOM, "/not_there"])} == {ODOM}


def test_a_recording_is_compressed_on_a_clean_close(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", recording=True)
    fill(writer, 200)
    before = writer.path.stat().st_size
    writer.close()
    assert writer.path.stat().st_size < before / 5
    assert sorted(path.name for path in writer.folder.iterdir()) == ["metadata.yaml", "run_0.mcap"]


def test_a_crash_while_compacting_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class CrashError(BaseException):
        pass

    rename = os.rename

    def crash(source: str, target: str, **folders: int) -> None:
        if target.endswith(".mcap"):
            raise CrashError
        rename(source, target, **folders)

    writer = BagWriter(tmp_path / "run", recording=True)
    fill(writer, 30)
    monkeypatch.setattr(os, "rename", crash)
    with pytest.raises(CrashError):
        writer.close()
    with BagReader(tmp_path / "run") as reader:
        assert reader.finished
        assert sum(1 for _ in reader.messages()) == 90


def test_a_full_disk_while_compacting_keeps_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, _: object) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("terrain_estimator.bags.writing.writer.compact", full)
    writer = BagWriter(tmp_path / "run", recording=True)
    fill(writer, 30)
    writer.close()
    assert "No space left on device" in writer.compaction_error
    with BagReader(tmp_path / "run") as reader:
        assert reader.finished
        assert reader.span.count == 90


def test_metadata_yaml_has_every_field_of_version_9(tmp_path: Path) -> None:
    fields = metadata_of(finished_bag(tmp_path / "run"))
    assert set(fields) == BAG_KEYS
    assert fields["version"] == 9
    assert fields["relative_file_paths"] == ["run_0.mcap"]
    assert fields["message_count"] == 60
    assert fields["duration"] == {"nanoseconds": 19 * STEP_NS}
    assert fields["starting_time"] == {"nanoseconds_since_epoch": STEP_NS}
    topics = fields["topics_with_message_count"]
    assert isinstance(topics, list)
    assert all(set(topic["topic_metadata"]) == TOPIC_KEYS for topic in topics)
    assert all(
        set(profile) == QOS_KEYS
        for topic in topics
        for profile in topic["topic_metadata"]["offered_qos_profiles"]
    )
    assert [topic["message_count"] for topic in topics] == [20, 20, 20]
    assert isinstance(fields["files"], list)
    assert all(set(file) == FILE_KEYS for file in fields["files"])


def test_the_file_carries_rosbag2s_own_copy_of_the_metadata(tmp_path: Path) -> None:
    folder = finished_bag(tmp_path / "run")
    with (folder / "run_0.mcap").open("rb") as file:
        copies = [
            record.metadata
            for record in make_reader(file).iter_metadata()
            if record.name == "rosbag2"
        ]
    assert [yaml.safe_load(copy["serialized_metadata"]) for copy in copies] == [metadata_of(folder)]


def test_type_hashes_are_those_of_the_installed_interfaces(tmp_path: Path) -> None:
    from ament_index_python.packages import get_package_share_directory  # noqa: PLC0415

    finished_bag(tmp_path / "run")
    with BagReader(tmp_path / "run") as reader:
        for topic in reader.topics.values():
            package, _, name = topic.type_name.split("/")
            description = Path(
                get_package_share_directory(package), "msg", f"{name}.json"
            ).read_text()
            assert topic.definition is not None
            assert f'"{topic.definition.type_hash}"' in description


def test_schemas_carry_the_unit_of_each_field_and_all_dependencies(tmp_path: Path) -> None:
    with BagReader(finished_bag(tmp_path / "run")) as reader:
        definition = reader.topics[SINKAGE].definition
    assert definition is not None
    assert "# [m] depth of the wheel's lowest point" in definition.text
    assert "MSG: std_msgs/Header\n" in definition.text
    assert "MSG: builtin_interfaces/Time\n" in definition.text


@pytest.mark.parametrize("recording", [False, True], ids=["offline", "recorded"])
def test_rosbags_opens_the_folder(tmp_path: Path, *, recording: bool) -> None:
    with BagWriter(tmp_path / "run", recording=recording) as writer:
        fill(writer, 20)
    with AnyReader([tmp_path / "run"]) as reader:
        velocities = [
            reader.deserialize(data, connection.msgtype).twist.twist.linear.x
            for connection, _, data in reader.messages()
            if connection.topic == ODOM
        ]
    assert velocities == [0.05 + step / 1e4 for step in range(20)]


@pytest.mark.parametrize("recording", [False, True], ids=["offline", "recorded"])
def test_mcaps_own_reader_and_ros2_decoder_open_the_file(
    tmp_path: Path, *, recording: bool
) -> None:
    with BagWriter(tmp_path / "run", recording=recording) as writer:
        fill(writer, 20)
    with writer.path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        decoded = [entry.decoded_message for entry in reader.iter_decoded_messages(topics=[SLIP])]
    assert [list(message.slip) for message in decoded] == [[step / 1000] * 4 for step in range(20)]


def test_quality_of_service_is_stored_by_its_names(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as writer:
        writer.add_topic("/state", TYPES[SLIP], qos=(STATE,))
        writer.add_topic("/sensor", TYPES[SLIP], qos=(Qos(reliability="best_effort"),))
    with BagReader(tmp_path / "run") as reader:
        state, sensor = (
            yaml.safe_load(reader.topics[name].qos_text)[0] for name in ("/state", "/sensor")
        )
    assert (state["durability"], state["reliability"]) == ("transient_local", "reliable")
    assert (sensor["durability"], sensor["reliability"]) == ("volatile", "best_effort")


def test_an_empty_bag_is_a_bag(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run"):
        pass
    with BagReader(tmp_path / "run") as reader:
        assert list(reader.messages()) == []
        assert reader.span.duration_ns == 0
    with AnyReader([tmp_path / "run"]) as other:
        assert other.message_count == 0


def test_messages_out_of_order_come_back_by_log_time(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for recording in (False, True):
        folder = tmp_path / str(recording)
        writer = BagWriter(folder, recording=recording)
        topic = writer.add_topic("/wheel_slip", TYPES[SLIP])
        data = writer.types.serialize(writer.types.make(TYPES[SLIP], wheel=["x" * 400]))
        times = np.arange(8000) + rng.integers(
            0, 300, 8000
        )  # several chunks, each overlapping the next
        for time in times:
            writer.write(topic, data, int(time))
        if recording:
            writer.abandon()
        else:
            writer.close()
        with BagReader(folder) as reader:
            assert [message.log_time_ns for message in reader.messages()] == sorted(times.tolist())


def test_the_files_of_a_split_recording_are_read_as_one(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for index, start in enumerate([0, 1000, 500]):
        with BagWriter(tmp_path / f"part{index}") as writer:
            topic = writer.add_topic("/wheel_slip", TYPES[SLIP])
            for time in range(start, start + 100 * (index + 1)):
                writer.write_message(topic, writer.types.make(TYPES[SLIP], sequence=time), time)
        (tmp_path / f"part{index}" / f"part{index}_0.mcap").rename(folder / f"run_{index}.mcap")
    with BagReader(folder) as reader:
        times = [reader.decode(message).sequence for message in reader.messages()]
        assert reader.topics["/wheel_slip"].count == 600
    assert times == sorted([*range(100), *range(1000, 1200), *range(500, 800)])


def test_old_messages_are_read_by_the_definition_in_the_bag(tmp_path: Path) -> None:
    from terrain_estimator.bags import Definition  # noqa: PLC0415 (only here)

    old = Definition("msg_defs/msg/WheelSlip", "float64[] slip\nstring note", "RIHS01_old")
    with BagWriter(tmp_path / "run") as writer:
        topic = writer.add_topic("/wheel_slip", old.type_name, definition=old)
        writer.types.add(old)
        writer.write_message(
            topic, writer.types.make(old.type_name, slip=[math.nan, 0.25], note="before"), 1
        )
    with BagReader(tmp_path / "run") as reader:
        [message] = [reader.decode(raw) for raw in reader.messages()]
        assert (message.slip[1], message.note) == (0.25, "before")
        assert any("another definition than the installed one" in note for note in reader.notes)


def test_a_message_is_made_with_zeros_for_what_is_not_given(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as writer:
        odom = writer.types.make("nav_msgs/msg/Odometry", child_frame_id="base_link")
        again = writer.types.deserialize(writer.types.serialize(odom), "nav_msgs/msg/Odometry")
        with pytest.raises(BagError, match="has no field 'child'"):
            writer.types.make("nav_msgs/msg/Odometry", child="x")
    assert again.child_frame_id == "base_link"
    assert again.pose.covariance.shape == (36,)
    assert not again.pose.covariance.any()


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    import tracemalloc  # noqa: PLC0415 (only here)

    def peak(steps: int) -> int:
        folder = tmp_path / str(steps)
        writer = BagWriter(folder, recording=True)
        topic = writer.add_topic("/wheel_slip", TYPES[SLIP])
        data = writer.types.serialize(writer.types.make(TYPES[SLIP], wheel=["x" * 1000]))
        for step in range(steps):
            writer.write(topic, data, step)
        writer.abandon()
        with BagReader(folder) as reader:
            tracemalloc.start()
            count = sum(1 for _ in reader.messages())
            _, most = tracemalloc.get_traced_memory()
            tracemalloc.stop()
        assert count == steps
        return most

    assert peak(12_000) < 1.3 * peak(4_000)
