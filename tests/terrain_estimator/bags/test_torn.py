# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sectors that a power cut tears or reorders cost what was not synced, and nothing before it.

A disk may write the sectors behind the last fsync in any order: each of them holds its new content,
zeros, or what stood there before.
"""

import random
from pathlib import Path

import numpy as np
import pytest

from terrain_estimator.bags import BagError, BagReader, BagWriter, recover
from terrain_estimator.estimator.saved_state import StateFileError, pack_state, unpack_state
from tests.terrain_estimator.bags.support import SLIP, TYPES

SECTOR = 512
CUTS = 40
SYNCED, LATER = 40, 40
"""Messages before and after the last fsync."""


def payload(number: int) -> bytes:
    return bytes([0, 1, 0, 0]) + number.to_bytes(4, "little") * 60


def recording(folder: Path) -> tuple[bytes, int]:
    """Return the content of an unfinished recording, and how much of it was synced."""
    bag = BagWriter(folder, recording=True)
    topic = bag.add_topic(SLIP, TYPES[SLIP])
    for number in range(SYNCED):
        bag.write(topic, payload(number), number)
    synced = bag.path.stat().st_size
    for number in range(SYNCED, SYNCED + LATER):
        bag.write(topic, payload(number), number)
    bag.abandon()
    return bag.path.read_bytes(), synced


def torn(content: bytes, synced: int, generator: random.Random) -> bytes:
    """Return what a cut leaves: any of the later sectors, up to any length."""
    left = bytearray(content[: generator.randrange(synced, len(content) + 1)])
    first = synced // SECTOR * SECTOR
    for start in range(first, len(left), SECTOR):
        if generator.random() < 0.4:
            begin, end = max(start, synced), min(start + SECTOR, len(left))
            left[begin:end] = bytes(end - begin)
    return bytes(left)


def test_torn_sectors_cost_no_message_that_was_synced(tmp_path: Path) -> None:
    content, synced = recording(tmp_path / "run")
    generator = random.Random(20)
    for cut in range(CUTS):
        folder = tmp_path / f"cut{cut}"
        folder.mkdir()
        (folder / f"cut{cut}_0.mcap").write_bytes(torn(content, synced, generator))
        assert set(range(SYNCED)) <= numbers(recovered(folder))
        try:
            found = numbers(folder)
        except BagError as error:
            assert "recover_bag" in str(error) or "damaged" in str(error)  # noqa: PT017
        else:
            assert set(range(SYNCED)) <= found


def recovered(folder: Path) -> Path:
    target = folder.with_name(f"{folder.name}_recovered")
    recover(folder, target)
    return target


def numbers(folder: Path) -> set[int]:
    """Return the numbers of the messages of a bag that are as they were written.

    A message has no sum of its own: one that was not synced may come back with zeros in it.
    """
    with BagReader(folder) as reader:
        found = [(message.log_time_ns, message.data) for message in reader.messages()]
    return {number for number, data in found if data == payload(number)}


def test_a_torn_state_is_refused() -> None:
    content = pack_state({"a": np.arange(2000.0)}, "model")
    generator = random.Random(20)
    for _ in range(200):
        left = torn(content, 0, generator)
        if left != content:
            with pytest.raises(StateFileError):
                unpack_state(left, "model", "state")
    assert set(unpack_state(content, "model", "state")) == {"a"}
