# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The synchronizer pairs by stamp, in stamp order, and counts everything that it does not use."""

import random

import pytest

from terrain_estimator.messaging.pairing import (
    CAPACITY,
    RESTART_AFTER,
    InputTopic,
    MessageSet,
    Synchronizer,
)

REQUIRED, OPTIONAL = ("slip", "sinkage", "odom"), ("joints", "imu")
TOPICS = (
    *(InputTopic(name, required=True) for name in REQUIRED),
    *(InputTopic(name, required=False) for name in OPTIONAL),
)
STEP = 100_000_000
NEVER = 10**18
Event = tuple[int, int]  # topic, stamp [ns]


def play(
    events: list[Event], tolerance_ns: int = 0, timeout_ns: int = 5 * STEP
) -> tuple[list[MessageSet], Synchronizer]:
    """Feed messages named after their topic and stamp, then end the input."""
    synchronizer = Synchronizer(TOPICS, tolerance_ns, timeout_ns)
    sets = [
        released
        for topic, stamp in events
        for released in synchronizer.add(topic, stamp, f"{topic}@{stamp}")
    ]
    return sets + synchronizer.flush(), synchronizer


def streams(seed: int, steps: int, jitter_ns: int = 0, loss: float = 0.1) -> list[list[Event]]:
    """Return five streams with missing messages and jittering stamps."""
    draw = random.Random(seed)

    def stream(topic: int) -> list[Event]:
        return [
            (topic, step * STEP + draw.randint(-jitter_ns, jitter_ns))
            for step in range(1, steps + 1)
            if draw.random() > loss
        ]

    return [stream(topic) for topic in range(len(TOPICS))]


def interleave(all_streams: list[list[Event]], draw: random.Random, skew_ns: int) -> list[Event]:
    """Merge streams at random, each in its order and none ahead by more than ``skew_ns``."""
    rest = [list(stream) for stream in all_streams]
    merged: list[Event] = []
    while any(rest):
        oldest = min(stream[0][1] for stream in rest if stream)
        ready = [stream for stream in rest if stream and stream[0][1] <= oldest + skew_ns]
        merged.append(draw.choice(ready).pop(0))
    return merged


def test_a_complete_set_is_released_at_once() -> None:
    synchronizer = Synchronizer(TOPICS)
    for topic in range(4):
        assert synchronizer.add(topic, STEP, topic) == []
    assert synchronizer.add(4, STEP, 4) == [MessageSet(STEP, (0, 1, 2, 3, 4))]
    assert all(counter.paired == 1 for counter in synchronizer.counters.values())


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(("jitter", "tolerance"), [(0, 0), (STEP // 5, STEP // 2)])
def test_any_interleaving_within_the_time_out_gives_the_same_sets(
    seed: int, jitter: int, tolerance: int
) -> None:
    data = streams(seed, steps=60, jitter_ns=jitter)
    expected, _ = play(
        sorted((event for stream in data for event in stream), key=lambda event: event[1]),
        tolerance,
    )
    assert len(expected) > 20
    for order in range(10):
        sets, synchronizer = play(
            interleave(data, random.Random(order), skew_ns=4 * STEP), tolerance
        )
        assert sets == expected
        for counter in synchronizer.counters.values():
            assert counter.received == counter.paired + counter.unpaired + counter.out_of_order


@pytest.mark.parametrize("seed", range(10))
def test_without_time_out_even_one_topic_after_the_other_gives_the_same_sets(seed: int) -> None:
    data = streams(seed, steps=60)
    expected, _ = play(interleave(data, random.Random(0), skew_ns=0), timeout_ns=NEVER)
    random.Random(seed).shuffle(data)
    assert play([event for stream in data for event in stream], timeout_ns=NEVER)[0] == expected


@pytest.mark.parametrize("seed", range(10))
def test_sets_come_in_the_order_of_their_stamps(seed: int) -> None:
    sets, _ = play(interleave(streams(seed, steps=60), random.Random(seed), skew_ns=3 * STEP))
    stamps = [each.stamp_ns for each in sets]
    assert stamps == sorted(set(stamps))


def test_a_missing_optional_message_leaves_a_gap_and_a_missing_required_one_drops_the_set() -> None:
    events = [
        (topic, step * STEP)
        for step in range(1, 5)
        for topic in range(5)
        if (topic, step) not in {(4, 2), (1, 3)}
    ]
    sets, synchronizer = play(events)
    assert [(each.stamp_ns // STEP, each.messages[4] is None) for each in sets] == [
        (1, False),
        (2, True),
        (4, False),
    ]
    assert [
        synchronizer.counters[name].unpaired
        for name in ("slip", "sinkage", "odom", "joints", "imu")
    ] == [1, 0, 1, 1, 1]


def test_a_topic_that_never_speaks_is_waited_for_until_the_time_out_in_stamps() -> None:
    synchronizer = Synchronizer(TOPICS, timeout_ns=5 * STEP)
    events = [(topic, step * STEP) for step in range(1, 10) for topic in range(4)]
    assert [
        each.stamp_ns // STEP for event in events for each in synchronizer.add(*event, None)
    ] == [1, 2, 3, 4]


def test_without_patience_the_messages_of_one_instant_are_paired_all_the_same() -> None:
    sets, synchronizer = play(
        [(topic, step * STEP) for step in range(1, 4) for topic in range(5)], timeout_ns=0
    )
    assert [(each.stamp_ns // STEP, None in each.messages) for each in sets] == [
        (1, False),
        (2, False),
        (3, False),
    ]
    assert synchronizer.counters["slip"].unpaired == 0


def test_one_topic_far_in_the_future_times_out_nothing() -> None:
    synchronizer = Synchronizer(TOPICS)
    synchronizer.add(4, NEVER, "wrong clock")
    released = [
        each.messages
        for step in range(1, 4)
        for topic in range(4)
        for each in synchronizer.add(topic, step * STEP, topic)
    ]
    assert released == [(0, 1, 2, 3, None)] * 3


@pytest.mark.parametrize("topic", range(5))
def test_a_topic_recovers_from_a_stamp_of_the_far_future(topic: int) -> None:
    events = [(each, step * STEP) for step in range(1, 40) for each in range(5)]
    events.insert(5 * 10, (topic, NEVER))
    sets, synchronizer = play(events)
    assert [each.stamp_ns // STEP for each in sets][-15:] == list(range(25, 40))
    assert sets[-1].messages[topic] is not None
    assert synchronizer.counters[TOPICS[topic].name].out_of_order == RESTART_AFTER - 1


def test_duplicates_and_old_stamps_are_counted_and_not_used() -> None:
    sets, synchronizer = play(
        [(0, STEP), (0, STEP), (0, STEP - 1), *((topic, STEP) for topic in range(1, 5))]
    )
    assert len(sets) == 1
    assert synchronizer.counters["slip"].out_of_order == 2


def test_the_nearest_stamp_within_the_tolerance_is_taken() -> None:
    events = [
        (1, STEP - 9),
        (1, STEP - 2),
        (1, STEP + 3),
        (2, STEP + 5),
        (0, STEP),
        (3, STEP + 6),
        (4, STEP - 6),
    ]
    (only,), synchronizer = play(events, tolerance_ns=5)
    assert only.messages == (f"0@{STEP}", f"1@{STEP - 2}", f"2@{STEP + 5}", None, None)
    assert synchronizer.counters["sinkage"].unpaired == 2


def test_gaps_in_the_sequence_are_counted_as_lost_and_a_restart_is_not() -> None:
    synchronizer = Synchronizer(TOPICS)
    for step, sequence in enumerate([0, 1, 4, 5, 0, 1], start=1):
        synchronizer.add(0, step * STEP, None, sequence)
    assert synchronizer.counters["slip"].lost == 2


def test_a_message_that_comes_after_its_successor_is_out_of_order_and_not_lost() -> None:
    synchronizer = Synchronizer(TOPICS)
    for number in (1, 2, 5, 4, 4, 6):
        synchronizer.add(0, number * STEP, None, number)
    counted = synchronizer.counters["slip"]
    assert (counted.lost, counted.out_of_order) == (
        1,
        2,
    ), "3 never came, 4 came late, and once more than it should"
    synchronizer.reset()
    synchronizer.add(0, STEP, None, 3)
    assert counted.lost == 1, "another 3"


def test_what_is_published_in_a_pause_is_not_lost() -> None:
    synchronizer = Synchronizer(TOPICS)
    for number in (0, 1, 3, 4):
        synchronizer.add(0, (1 + number) * STEP, None, number)
    synchronizer.flush()
    for number in (100, 101, 103):
        synchronizer.add(0, (1 + number) * STEP, None, number)
    assert synchronizer.counters["slip"].lost == 2, "2 and 102"


def test_memory_is_bounded_when_partners_never_come() -> None:
    synchronizer = Synchronizer(TOPICS)
    for step in range(3 * CAPACITY):
        assert synchronizer.add(0, step * STEP, None) == []
    assert synchronizer.counters["slip"].unpaired == 2 * CAPACITY
    synchronizer.flush()
    assert synchronizer.counters["slip"].unpaired == 3 * CAPACITY


def test_after_a_reset_earlier_stamps_are_taken_again() -> None:
    events = [(topic, step * STEP) for step in (1, 2, 3) for topic in range(5)]
    sets, synchronizer = play(events)
    synchronizer.reset()
    assert [
        each
        for topic, stamp in events
        for each in synchronizer.add(topic, stamp, f"{topic}@{stamp}")
    ] == sets


def test_an_optional_reference_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="imu"):
        Synchronizer((InputTopic("imu", required=False),))
