# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read and write metadata.yaml of a bag folder: version 9 of rosbag2 (ROS 2 Jazzy)."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from rover_parameters.records import ConfigError, shortened
from rover_parameters.yaml_files import read_yaml
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.qos import Qos
from terrain_estimator.files.atomic import write_file

VERSION = 9
_WITHOUT = "delete it to read the .mcap files of the folder without it"
METADATA_FILE = "metadata.yaml"
STORAGES = ("mcap", "sqlite3")
PACKED = ("file", "message")
"""Compression modes of rosbag2 beside none; a reader sees from the bytes what is packed."""
ROSBAG2_RECORD = "rosbag2"  # MCAP metadata record in which rosbag2 keeps a copy of metadata.yaml
NO_TIME = 2**63 - 1  # what rosbag2 writes as starting time of an empty bag


@dataclass(slots=True)
class TopicCount:
    """A topic of a bag and the number of its messages."""

    name: str
    type_name: str
    type_hash: str
    qos: tuple[Qos, ...] = ()
    count: int = 0


@dataclass(slots=True)
class TimeSpan:
    """Log times [ns] of the messages counted so far."""

    first_ns: int = NO_TIME
    last_ns: int = 0
    count: int = 0

    def add(self, log_time_ns: int) -> None:
        """Count one message."""
        self.first_ns = min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)
        self.count += 1

    @property
    def duration_ns(self) -> int:
        """Return the time between the first and the last message [ns]."""
        return self.last_ns - self.first_ns if self.count else 0

    @classmethod
    def of(cls, parts: Iterable["TimeSpan"]) -> "TimeSpan":
        """Return the span of several files."""
        spans = [part for part in parts if part.count]
        if not spans:
            return cls()
        return cls(
            min(span.first_ns for span in spans),
            max(span.last_ns for span in spans),
            sum(span.count for span in spans),
        )


@dataclass(frozen=True, slots=True)
class StoredMetadata:
    """The part of a metadata.yaml that a reader needs."""

    files: tuple[str, ...]
    span: TimeSpan
    custom: dict[str, str] = field(default_factory=dict)


def information(
    topics: Sequence[TopicCount], files: Mapping[str, TimeSpan], custom: dict[str, str]
) -> dict[str, Any]:
    """Return the fields of ``rosbag2_bagfile_information`` for a bag of several files.

    ``files`` are the time spans by file name, in the order of the files.

    Source: rosbag2_storage, ``yaml.hpp``, ``convert<BagMetadata>``.
    """
    whole = TimeSpan.of(files.values())
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": whole.duration_ns},
        "starting_time": {"nanoseconds_since_epoch": whole.first_ns},
        "message_count": whole.count,
        "topics_with_message_count": [_topic(topic) for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": list(files),
        "files": [
            {
                "path": name,
                "starting_time": {"nanoseconds_since_epoch": span.first_ns},
                "duration": {"nanoseconds": span.duration_ns},
                "message_count": span.count,
            }
            for name, span in files.items()
        ],
        "custom_data": custom or None,
        "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
    }


def write_metadata(folder: Path, fields: dict[str, Any]) -> None:
    """Write metadata.yaml atomically: it is either whole or absent."""
    write_file(folder / METADATA_FILE, dump({"rosbag2_bagfile_information": fields}))


def dump(fields: dict[str, Any]) -> str:
    """Return YAML in rosbag2's order of keys, without aliases: users of yaml-cpp expect none."""
    return yaml.dump(fields, Dumper=_PlainDumper, sort_keys=False)


def read_metadata(path: Path) -> StoredMetadata:
    """Read a metadata.yaml of any version.

    Raises:
        BagError: it is not valid YAML, lacks a field, names an unknown storage or compression.
    """
    try:
        content: Any = read_yaml(path)
    except ConfigError as error:
        raise BagError(f"{path} is damaged ({error}): {_WITHOUT}") from error
    try:
        fields = content["rosbag2_bagfile_information"]
        storage, mode = fields["storage_identifier"], fields.get("compression_mode") or ""
        first, duration = (
            fields["starting_time"]["nanoseconds_since_epoch"],
            fields["duration"]["nanoseconds"],
        )
        span = TimeSpan(int(first), int(first) + int(duration), int(fields["message_count"]))
        files = tuple(Path(name).name for name in fields["relative_file_paths"])
        stored = StoredMetadata(files, span, _texts(fields.get("custom_data") or {}))
        packing = fields.get("compression_format") or "" if str(mode).lower() in PACKED else ""
        known = str(mode).lower() in {"", "none", *PACKED} and packing in {"", "zstd"}
    except Exception as error:
        raise BagError(
            f"{path} is damaged ({type(error).__name__}: {shortened(str(error))}): {_WITHOUT}"
        ) from error
    if storage not in STORAGES or not known:
        what = (
            f"storage {shortened(storage)}"
            if storage not in STORAGES
            else f"compression {shortened(mode)} {shortened(packing)}".rstrip()
        )
        raise BagError(
            f"{path}: {what} is not supported; convert it to uncompressed mcap with `ros2 bag"
            " convert` or `rosbags-convert`"
        )
    return stored


def _texts(custom: Mapping[str, object]) -> dict[str, str]:
    """Return ``custom_data``; a number without quotes is a text too, null an empty one."""
    return {key: "" if value is None else str(value) for key, value in custom.items()}


def _topic(topic: TopicCount) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type_name,
            "serialization_format": "cdr",
            "offered_qos_profiles": [profile.as_dict() for profile in topic.qos],
            "type_description_hash": topic.type_hash,
        },
        "message_count": topic.count,
    }


class _PlainDumper(yaml.SafeDumper):
    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002
        return True
