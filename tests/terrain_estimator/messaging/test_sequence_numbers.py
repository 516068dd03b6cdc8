# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Missing messages are counted by their sequence numbers, and reported by replay."""

import json
from pathlib import Path

import pytest

from terrain_estimator.bags import (
    BagWriter,
    Definition,
    Types,
    installed_definition,
    is_sequenced,
    sequence_of,
)
from terrain_estimator.cli import replay
from terrain_estimator.messaging.sequence_numbers import GAPS, Sequence, Sequences
from terrain_estimator.topics import ADVICE, ESTIMATE, HEALTH, INPUT_TYPES, PREDICTION, TRUTH
from tests.drives import STEP_NS, drive_messages

MESSAGES = Path(__file__).parents[3] / "msg_defs/msg"
PUBLISHED = {
    "terrain_estimate": ESTIMATE,
    "motion_prediction": PREDICTION,
    "estimator_health": HEALTH,
    "ground_truth/terrain": TRUTH,
    "traction_advice": ADVICE,
}
SEQUENCED = {*PUBLISHED.values(), INPUT_TYPES["wheel_slip"], INPUT_TYPES["wheel_sinkage"]}


def test_every_message_of_ours_with_a_sequence_number_begins_with_it() -> None:
    numbered = {
        f"msg_defs/msg/{file.stem}"
        for file in MESSAGES.glob("*.msg")
        if "uint64 sequence " in file.read_text(encoding="utf-8")
    }
    assert numbered == SEQUENCED
    for kind in SEQUENCED:
        assert is_sequenced(installed_definition(kind)), kind
    assert not is_sequenced(installed_definition("msg_defs/msg/MeasurementDecision"))
    assert not is_sequenced(installed_definition("nav_msgs/msg/Odometry"))
    assert not is_sequenced(Definition(ESTIMATE, "float64 cohesion\n", ""))
    assert not is_sequenced(Definition(ESTIMATE, "no definition", ""))
    assert not is_sequenced(None)


@pytest.mark.parametrize("kind", sorted(SEQUENCED))
def test_the_number_is_read_where_decoding_finds_it(kind: str) -> None:
    types = Types()
    for length in range(17):
        header = types.make("std_msgs/msg/Header", frame_id="x" * length)
        message = types.make(kind, header=header, sequence=2**40 + length)
        for little_endian in (True, False):
            data = bytes(types._store.serialize_cdr(message, kind, little_endian=little_endian))
            assert sequence_of(data) == types.deserialize(data, kind).sequence == 2**40 + length
            assert sequence_of(data[:10]) is None


def test_a_publisher_that_starts_again_is_no_gap() -> None:
    sequences = Sequences()
    for number in (7, 8, 0, 1, 4, 4, 5):
        sequences.note("/a", number)
    sequences.note("/b", 3)
    assert +sequences.lost == {"/a": 2}


def test_what_comes_late_is_not_lost() -> None:
    sequences = Sequences()
    for number in (
        0,
        4,
        2,
        3,
        5,
        9,
        7,
        0,
        3,
        2,
        4,
    ):  # the second 0 is of a publisher that started again: 6 and 8 never come
        sequences.note("/a", number)
    assert (+sequences.lost, +sequences.late) == ({"/a": 1 + 2 + 1}, {"/a": 2 + 1 + 1})


@pytest.mark.parametrize(
    ("numbers", "lost", "late"),
    [
        ([0, 1, 3, 2, 2, 4, 5], 0, 1),  # every message comes twice, and this one late
        ([0, 0, 2, 2, 1, 1, 4, 4, 3, 3, 5], 0, 2),
        ([5, 6, 7, 8, 6, 8, 9, 11], 1, 0),
        ([5, 6, 7, 8, 6, 6, 5, 9, 11], 1, 0),
        ([0, 1, 0, 1, 2, 4], 1, 0),  # a publisher that starts again
        ([5, 6, 7, 8, 0, 3, 4], 2, 0),
    ],
)
def test_a_copy_is_told_from_a_publisher_that_starts_again(
    numbers: list[int], lost: int, late: int
) -> None:
    sequences = Sequences()
    for number in numbers:
        sequences.note("/a", number)
    assert (sequences.lost["/a"], sequences.late["/a"]) == (lost, late)


def test_a_late_message_is_counted_once_and_not_for_ever() -> None:
    sequence = Sequence()
    assert [sequence.note(number) for number in (0, 2**64 - 1)] == [0, 2**64 - 2]
    assert [
        number for number in (0, 1, 1, 2**63, 2**63, 2**64 - 2, 2**64 - 1) if sequence.fill(number)
    ] == [1, 2**63, 2**64 - 2]
    sequence.restart()
    for number in range(0, 256, 2):
        sequence.note(number)
    kept = [number for number in range(1, 256) if sequence.fill(number)]
    assert kept == list(range(127, 254, 2)), "of 127 gaps the newest 64"


def test_messages_in_order_do_not_crowd_out_what_is_missing() -> None:
    sequence = Sequence()
    for number in (0, *range(2, 2 + 4 * GAPS)):
        sequence.note(number)
    assert sequence.fill(1)


def test_a_replay_says_what_is_missing_of_every_topic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    types = Types()
    expected = {f"/rover1/{name}": 1 + at for at, name in enumerate(PUBLISHED)}
    with BagWriter(tmp_path / "drive") as writer:
        topics = {
            name: writer.add_topic(f"/rover1/{name}", kind)
            for name, kind in (INPUT_TYPES | PUBLISHED).items()
        }
        for name, stamp, message in drive_messages(types.make, 1.0):
            writer.write(topics[name], types.serialize(message), stamp)
        start = stamp - 9 * STEP_NS
        for name, kind in PUBLISHED.items():
            lost = range(2, 2 + expected[f"/rover1/{name}"])
            for number in sorted(set(range(10)) - set(lost)):
                header = types.make("std_msgs/msg/Header", frame_id=name)
                message = types.make(kind, header=header, sequence=number)
                writer.write(topics[name], types.serialize(message), start + number * STEP_NS)
        late = types.make(PUBLISHED["traction_advice"], sequence=3)
        writer.write(topics["traction_advice"], types.serialize(late), stamp)
        expected["/rover1/traction_advice"] -= 1
    page = tmp_path / "page.html"
    assert (
        replay.main(
            [
                str(tmp_path / "drive"),
                "--out",
                str(tmp_path / "out"),
                "--namespace",
                "rover1",
                "--report",
                str(page),
            ]
        )
        == 0
    )
    [summary] = json.loads((tmp_path / "out/summary.json").read_text())["bags"]
    assert (summary["lost"], summary["late"]) == (expected, {"/rover1/traction_advice": 1})
    said, shown = capsys.readouterr().out, page.read_text(encoding="utf-8")
    for topic, count in expected.items():
        late_too = "1 out of order, " if topic in summary["late"] else ""
        words = f"drive: {topic}: {late_too}{count} lost, by the sequence numbers in the messages"
        assert words in said
        assert words in shown
