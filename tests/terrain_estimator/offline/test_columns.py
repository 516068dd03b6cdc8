# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Replay by columns against the replay of one message at a time: the same bytes.

160 drawn recordings (12 in the short run), so that a fault in 2 % of such recordings escapes with a
probability of 4 % (78 %). Of a fault in a quarter of them the short run misses 3 %.
"""

import copy
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain_estimator.bags import BagReader, RawMessage, Types
from terrain_estimator.compiled.finding import Chosen, load
from terrain_estimator.config.estimator import (
    AUTO,
    ConversionConfig,
    CoreConfig,
    EstimatorConfig,
    PairingConfig,
)
from terrain_estimator.messaging.columns import Observations
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.offline import column_reader
from terrain_estimator.offline.replay import replay
from terrain_estimator.offline.replay_result import Replay
from terrain_estimator.offline.summary import remarks, summary
from terrain_estimator.offline.topic_mapping import bag_topics
from terrain_estimator.topics import INPUT_TYPES
from tests.drives import START_NS, Event, drive_messages, write_bag
from tests.samples import sampled

RUNS = sampled(12, 160)
SECONDS = 5.0
NUMBERS = (np.nan, np.inf, -np.inf, -1.0, -0.0, 0.0, 0.5, 1e-320, 1e300, -1e300)
NUMBERS_OF = {
    "wheel_slip": ("slip", "slip_stddev"),
    "wheel_sinkage": (
        "sinkage",
        "sinkage_stddev",
        "contact_angle",
        "contact_angle_stddev",
    ),
    "joint_states": ("position", "velocity", "effort"),
    "odom": (
        "twist.covariance",
        "pose.covariance",
        "twist.twist.linear.x",
        "twist.twist.linear.y",
        "twist.twist.angular.z",
    ),
    "imu": (
        "orientation_covariance",
        "linear_acceleration_covariance",
        "linear_acceleration.x",
        "angular_velocity.z",
        "angular_velocity_covariance",
        "orientation.w",
        "orientation.x",
    ),
}
CORES = (
    CoreConfig(),
    CoreConfig(use_imu=False),
    CoreConfig(use_torque=False, use_moments=False),
    CoreConfig(use_moments=False, contact_angle_sd=0.03),
    CoreConfig(use_sinkage=False),
)
TYPES = Types()


@cache
def model() -> Chosen:
    return load("", AUTO)


@cache
def drive() -> list[Event]:
    return list(drive_messages(TYPES.make, SECONDS, 3))


@contextmanager
def one_by_one() -> Iterator[None]:
    """Leave no message to the columns: the way of the live node."""
    with mock.patch.object(column_reader, "FEWEST", 1 << 30):
        yield


def replayed(bag: Path, out: Path, config: EstimatorConfig, namespace: str) -> Replay:
    with mock.patch.object(os, "sched_getaffinity", return_value={0}):
        return replay(bag, out, model(), config, bag_topics([], namespace))


def outcome(
    bag: Path, config: EstimatorConfig, namespace: str
) -> tuple[list[RawMessage], dict[str, Any], Any]:
    """Return all messages of the estimates bag, and everything that is said of the run."""
    out = bag.parent / "out"
    shutil.rmtree(out, ignore_errors=True)
    done = replayed(bag, out, config, namespace)
    with BagReader(out) as reader:
        messages = list(reader.messages())
    said = summary([done], model().model, config)
    for each in said["bags"]:
        del each["wall_s"], each["times_real_time"]
    spans = (done.slip.spans, done.sinkage.spans)
    lines = [line for line in remarks(done) if "real time" not in line]
    # exact, but for the NaN of the estimates within
    history = [(span.stamp_ns, span.count, span.outcomes) for span in done.history.spans]
    return messages, said, (spans, lines, json.dumps(repr(history)), done.refusals.words())


def check(bag: Path, config: EstimatorConfig, namespace: str = "") -> None:
    by_columns = outcome(bag, config, namespace)
    with one_by_one():
        single = outcome(bag, config, namespace)
    assert by_columns == single


def _set(message: Any, path: str, at: int, value: float) -> None:
    *parts, last = path.split(".")
    for part in parts:
        message = getattr(message, part)
    old = getattr(message, last)
    if isinstance(old, np.ndarray):
        if old.size:
            changed = old.copy()
            changed[at % old.size] = value
            setattr(message, last, changed)
    else:
        setattr(message, last, value)


def spoil(message: Any, topic: str, draw: st.DataObject) -> None:
    """Damage one message: a number, a text or the length of an array."""
    kind = draw.draw(st.sampled_from(["number", "number", "number", "frame", "shorter", "name"]))
    path = draw.draw(st.sampled_from(NUMBERS_OF[topic]))
    if kind == "number":
        value = draw.draw(st.sampled_from(NUMBERS))
        _set(message, path, draw.draw(st.integers(0, 35)), value)
    elif kind == "frame":
        message.header.frame_id = draw.draw(st.sampled_from(["", "base_lin", "wheel_left"]))
    elif kind == "shorter" and topic not in {"odom", "imu"}:
        setattr(message, path, getattr(message, path)[: draw.draw(st.integers(0, 3))])
    elif kind == "name" and topic not in {"odom", "imu"}:
        field = "name" if topic == "joint_states" else "wheel"
        names = list(getattr(message, field))
        names[0] = draw.draw(st.sampled_from([names[0][::-1], names[1], "x"]))
        setattr(message, field, names)


def _event(event: Event, stamp_ns: int) -> Event:
    topic, _, message = event
    moved = copy.deepcopy(message)
    moved.header.stamp.sec, moved.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return topic, stamp_ns, moved


def recording(draw: st.DataObject) -> list[Event]:
    """Draw a recording: its rate, its gaps and jumps, and what is damaged."""
    step_ns = draw.draw(st.sampled_from([100, 100, 100, 20, 60, 130, 400])) * 1_000_000
    jump = draw.draw(st.integers(0, 80))
    jump_ns = draw.draw(st.sampled_from([0, 0, 0, 3_000_000_000, -2_000_000_000]))
    missing = draw.draw(
        st.sampled_from([(), (), ("imu",), ("joint_states",), ("imu", "joint_states")])
    )
    jitter_ns = draw.draw(st.sampled_from([0, 0, 0, 2_000_000]))
    events = []
    for event in drive():
        number = (event[1] - START_NS) // 100_000_000
        shift = jitter_ns * list(INPUT_TYPES).index(event[0])
        stamp = START_NS + number * step_ns + shift + (jump_ns if number >= jump else 0)
        if event[0] not in missing:
            events.append(_event(event, stamp))
    changed = draw.draw(st.integers(0, len(events) - 1))
    topic = draw.draw(st.sampled_from([*INPUT_TYPES, ""]))
    for each, _, message in events[changed:]:
        if each == topic:  # from here on another text, of the same length or of another one
            message.header.frame_id = draw.draw(st.sampled_from(["base_linl", "a_rover_frame"]))
    for _ in range(draw.draw(st.integers(0, 12))):
        at = draw.draw(st.integers(0, len(events) - 1))
        what = draw.draw(st.sampled_from(["spoil", "spoil", "drop", "double", "swap"]))
        if what == "spoil":
            spoil(events[at][2], events[at][0], draw)
        elif what == "drop":
            del events[at]
        elif what == "double":
            events.insert(at, events[at])
        else:
            other = draw.draw(st.integers(0, len(events) - 1))
            events[at], events[other] = events[other], events[at]
    # a bag holds messages in the order of arrival
    return [
        (name, START_NS + number * 1000, message)
        for number, (name, _, message) in enumerate(events)
    ]


def configuration(draw: st.DataObject) -> EstimatorConfig:
    return EstimatorConfig(
        core=draw.draw(st.sampled_from(CORES)),
        conversion=ConversionConfig(body_frame=draw.draw(st.sampled_from(["", "", "base_link"]))),
        pairing=PairingConfig(tolerance_s=draw.draw(st.sampled_from([0.0, 0.015]))),
    )


@settings(max_examples=RUNS)
@given(st.data())
def test_a_drawn_recording_gives_the_same_bytes_by_columns_and_one_by_one(
    draw: st.DataObject,
) -> None:
    events, config = recording(draw), configuration(draw)
    namespace = draw.draw(st.sampled_from(["", "/rover_2"]))
    truncated = draw.draw(st.sampled_from([0, 0, 0, 1, 77, 4000]))
    with tempfile.TemporaryDirectory() as folder:
        bag = write_bag(Path(folder) / "drive", iter(events), TYPES, namespace, recording=True)
        if truncated:
            file = next(bag.glob("*.mcap"))
            file.write_bytes(file.read_bytes()[:-truncated])
        check(bag, config, namespace)


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return where the numbers of the sets that went by columns are kept."""
    taken: list[int] = []
    observe = Pipeline.observe

    def counted(*arguments: Any) -> Observations | None:
        many = observe(*arguments)
        taken.append(0 if many is None else sum(many.ordinary))
        return many

    monkeypatch.setattr(Pipeline, "observe", counted)
    return taken


def test_an_ordinary_drive_goes_by_columns(tmp_path: Path, taken: list[int]) -> None:
    bag = write_bag(tmp_path / "drive", iter(drive()), TYPES)
    done = replayed(bag, tmp_path / "out", EstimatorConfig(), "")
    assert sum(taken) == done.estimates == 50


@pytest.mark.parametrize("sizes", [(6, 6), (3, 0)])
def test_motion_across_changes_no_byte_by_columns_or_one_by_one(
    sizes: tuple[int, int], tmp_path: Path, taken: list[int]
) -> None:
    events = copy.deepcopy(drive())
    for topic, _, message in events:
        if topic == "wheel_slip":
            message.lateral_slip, message.slip_angle = (np.full(size, 0.1) for size in sizes)
    bare, filled = (
        write_bag(tmp_path / name / "drive", iter(given), TYPES)
        for name, given in (("bare", drive()), ("filled", events))
    )
    expected = outcome(bare, EstimatorConfig(), "")[0]
    assert outcome(filled, EstimatorConfig(), "")[0] == expected
    assert sum(taken) == 100
    with one_by_one():
        assert outcome(filled, EstimatorConfig(), "")[0] == expected
    assert sum(taken) == 100


@pytest.mark.parametrize("reference", ["undisturbed", "Local", "undisturbeD"])
def test_sinkage_from_other_ground_is_refused_by_columns_and_one_by_one(
    reference: str, tmp_path: Path, taken: list[int]
) -> None:
    """From the 20th set on."""
    events = copy.deepcopy(drive())
    for topic, stamp, message in events:
        if topic == "wheel_sinkage":
            late = stamp >= START_NS + 19 * 100_000_000
            message.reference = reference if late else "undisturbed"
    bag = write_bag(tmp_path / "drive", iter(events), TYPES)
    check(bag, EstimatorConfig())
    words = outcome(bag, EstimatorConfig(), "")[2][3]
    used = 50 if reference == "undisturbed" else 19
    assert sum(taken) == 2 * used
    assert ("31 WRONG_FRAME" in words and repr(reference) in words) == (used == 19), words


@pytest.mark.parametrize("size", [2, 11, 100])
def test_sets_of_several_batches_give_the_same_bytes(
    size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("terrain_estimator.offline.converted.BATCH", size)
    monkeypatch.setattr(column_reader, "FEWEST", 1)
    check(write_bag(tmp_path / "drive", iter(drive()), TYPES), EstimatorConfig())


def test_messages_with_bytes_left_at_their_ends_are_read_like_others(tmp_path: Path) -> None:
    class Longer(Types):
        def serialize(self, message: Any) -> bytes:
            return super().serialize(message) + bytes(4)

    types = Longer()
    check(
        write_bag(tmp_path / "drive", drive_messages(types.make, SECONDS), types), EstimatorConfig()
    )
