# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Time to read and decode every message of a bag, beside rosbags and mcap-ros2-support."""

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from benchmarks.drives import long_drive
from benchmarks.lines import BenchmarkLine, Effort
from terrain_estimator.bags import BagReader, Types
from tests.drives import write_bag

SECONDS = 600.0
RUNS = 3  # of each in turn; the fastest counts: what else the machine does only slows it down


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the time of a message, beside both libraries."""
    with tempfile.TemporaryDirectory() as folder:
        types = Types()
        bag = write_bag(
            Path(folder) / "drive",
            long_drive(types.make, effort.seconds(SECONDS, least=5.0)),
            types,
        )
        readers = {"ours": ours, "rosbags": by_rosbags, "mcap-ros2-support": by_mcap}
        spent = {name: min(times) for name, times in _in_turn(bag, readers).items()}
    for name in ("rosbags", "mcap-ros2-support"):
        yield BenchmarkLine(
            f"reading a bag, beside {name}",
            spent["ours"],
            "us/message",
            spent[name],
            reference=name,
            against=spent[name],
        )


def _in_turn(bag: Path, readers: Mapping[str, Callable[[Path], int]]) -> dict[str, list[float]]:
    spent: dict[str, list[float]] = {name: [] for name in readers}
    for _ in range(RUNS):
        counts = set()
        for name, read in readers.items():
            begun_s = time.perf_counter()
            counts.add(read(bag))
            spent[name].append(1e6 * (time.perf_counter() - begun_s) / max(counts))
        if len(counts) != 1:
            raise ArithmeticError(f"the readers found {sorted(counts)} messages in one bag")
    return spent


def ours(bag: Path) -> int:
    """Decode all messages with this package; return their number."""
    with BagReader(bag) as reader:
        return sum(reader.decode(message) is not None for message in reader.messages())


def by_rosbags(bag: Path) -> int:
    """Decode all messages with rosbags; return their number."""
    with AnyReader([bag]) as reader:
        return sum(
            reader.deserialize(data, connection.msgtype) is not None
            for connection, _, data in reader.messages()
        )


def by_mcap(bag: Path) -> int:
    """Decode all messages with mcap-ros2-support; return their number."""
    with next(bag.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return sum(entry.decoded_message is not None for entry in reader.iter_decoded_messages())
