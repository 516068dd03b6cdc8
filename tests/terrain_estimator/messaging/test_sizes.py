# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that wait for partners are bounded in bytes, whatever their size."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pairing import CAPACITY_BYTES
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.messaging.sizes import LARGEST_MESSAGE, Oversized, message_bytes
from terrain_estimator.model.model_file import load_model
from terrain_estimator.outcome import Outcome
from tests.drives import STEP_NS, drive_messages
from tests.samples import sampled

TYPES = Types()
PAGE = os.sysconf("SC_PAGE_SIZE")


@pytest.fixture(scope="module")
def pipeline() -> Pipeline:
    return Pipeline(load_model(), EstimatorConfig())


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6


def slip(step: int, names: list[str], values: int) -> Any:
    sec, nanosec = divmod(10**9 + step * STEP_NS, 10**9)
    stamp = TYPES.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return TYPES.make(
        "msg_defs/msg/WheelSlip",
        header=TYPES.make("std_msgs/msg/Header", stamp=stamp, frame_id="base_link"),
        sequence=step,
        wheel=names,
        slip=np.ones(values),
        slip_stddev=np.ones(values),
    )


@pytest.mark.parametrize(
    ("names", "values"),
    [(["w"] * 10**6, 10**6), (["w" * 10**6] * 6, 6), (["w"] * 6, 10**6), (["w" * 30_000] * 6, 6)],
)
def test_messages_without_partners_take_bounded_memory(
    pipeline: Pipeline, names: list[str], values: int
) -> None:
    pipeline.reset()
    pipeline.add("wheel_slip", slip(0, names, values))
    before = resident_mb()
    for step in range(1, sampled(21, 101)):
        copies = [name + str(step) for name in names] if len(names) < 10 else names
        assert pipeline.add("wheel_slip", slip(step, copies, values)) == []
    assert resident_mb() - before < 2.0 * CAPACITY_BYTES / 1e6


def test_a_set_with_a_message_far_too_large_is_refused_by_name(pipeline: Pipeline) -> None:
    pipeline.reset()
    answers = []
    for topic, _, message in drive_messages(TYPES.make, 0.3):
        if topic == "wheel_slip":
            message.wheel = [f"wheel {at}" for at in range(1000)]
        if topic == "joint_states":
            message.name = [*message.name, "x" * LARGEST_MESSAGE]
        answers += pipeline.add(topic, message)
    decisions = [answer.update.decision for answer in answers]
    assert {each.outcome for each in decisions} == {Outcome.WRONG_WHEELS}
    assert decisions[0].detail == "wheel_slip: a message with 1000 wheels is left out"


def test_joints_far_too_large_cost_their_rows_alone(pipeline: Pipeline) -> None:
    pipeline.reset()
    answers = []
    for topic, _, message in drive_messages(TYPES.make, 0.3):
        if topic == "joint_states":
            message.name = [*message.name, "x" * LARGEST_MESSAGE]
        answers += pipeline.add(topic, message)
    assert {answer.update.decision.outcome for answer in answers} == {Outcome.ACCEPTED}
    assert answers[0].notes == ("joint_states: a message with 0.264 MB is left out",)


def test_the_size_of_a_message_counts_its_texts_lists_and_arrays() -> None:
    plain, *_ = (each for topic, _, each in drive_messages(TYPES.make, 0.1) if topic == "odom")
    small = message_bytes(plain)
    plain.child_frame_id = "x" * 10**6
    assert message_bytes(plain) - small == pytest.approx(10**6, rel=1e-3)
    assert message_bytes(Oversized(None, 0, "")) < 2000
