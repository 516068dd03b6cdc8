# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bags to test with, and ways to damage them."""

from pathlib import Path

from mcap.opcode import Opcode

from terrain_estimator.bags import BagWriter
from terrain_estimator.bags.reading.records import HEAD, MAGIC, Record, scan

WHEELS = ["front_left", "front_right", "rear_left", "rear_right"]
SLIP, SINKAGE, ODOM = "/wheel_slip", "/wheel_sinkage", "/odom"
TYPES = {
    SLIP: "msg_defs/msg/WheelSlip",
    SINKAGE: "msg_defs/msg/WheelSinkage",
    ODOM: "nav_msgs/msg/Odometry",
}
STEP_NS = 100_000_000


def fill(writer: BagWriter, steps: int) -> None:
    """Write one message a topic and step; slip, sinkage and velocity tell the step."""
    topics = {name: writer.add_topic(name, kind) for name, kind in TYPES.items()}
    for step in range(steps):
        time_ns = (step + 1) * STEP_NS
        stamp = writer.types.make(
            "builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9
        )
        header = writer.types.make("std_msgs/msg/Header", stamp=stamp, frame_id="base_link")
        slip = writer.types.make(
            TYPES[SLIP],
            header=header,
            sequence=step,
            wheel=WHEELS,
            slip=[step / 1000] * 4,
            slip_stddev=[0.01] * 4,
        )
        sinkage = writer.types.make(
            TYPES[SINKAGE],
            header=header,
            sequence=step,
            wheel=WHEELS,
            sinkage=[0.02 + step / 1e5] * 4,
        )
        odom = writer.types.make(TYPES[ODOM], header=header)
        odom.twist.twist.linear.x = 0.05 + step / 1e4
        for name, message in ((SLIP, slip), (SINKAGE, sinkage), (ODOM, odom)):
            writer.write_message(topics[name], message, time_ns, time_ns - 1000)


def finished_bag(folder: Path, steps: int = 20) -> Path:
    """Write a bag and close it."""
    with BagWriter(folder, custom={"seed": "7"}) as writer:
        writer.add_metadata("model", {"sha256": "abc"})
        fill(writer, steps)
    return folder


def killed_recording(folder: Path, steps: int = 20) -> Path:
    """Write a recording and never close it, as kill -9 does; return its file."""
    writer = BagWriter(folder, recording=True)
    fill(writer, steps)
    writer.abandon()
    return writer.path


def records(path: Path) -> list[Record]:
    """Return all whole records of a file in order."""
    with path.open("rb") as file:
        return [record for record in scan(file, len(MAGIC), path.stat().st_size) if record.whole]


def corrupt(path: Path, opcode: Opcode, which: int = 0, at: int = 40) -> None:
    """Flip one byte of a chosen record's payload; fails where there is no such record."""
    found = [record for record in records(path) if record.opcode == opcode]
    assert len(found) > which, f"{path} has {len(found)} records {opcode.name}, nothing to corrupt"
    assert len(found[which].payload) > at, (
        f"record {opcode.name} has only {len(found[which].payload)} bytes"
    )
    data = bytearray(path.read_bytes())
    data[found[which].offset + HEAD.size + at] ^= 0xFF
    path.write_bytes(data)
