# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A mast and an arm on joint_states, as on many rovers, cost the wheels nothing."""

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from rover_parameters.parameters import configure
from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.config.planner import PlannerConfig
from terrain_estimator.config.slip_source import SlipSourceConfig
from terrain_estimator.messaging.pairing import Counters
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.messaging.slip_source import JOINTS, VELOCITY, SlipSource
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.planning.inputs import PlannerInputs
from terrain_estimator.topics import Message
from tests.drives import ROVER, STEP_NS, Event, drive_messages

TYPES = Types()
STEPS = 5
TOLERANCE = {"pairing_tolerance": 0.02}


def mast(stamp_ns: int) -> Event:
    sec, nanosec = divmod(stamp_ns, 10**9)
    header = TYPES.make(
        "std_msgs/msg/Header",
        stamp=TYPES.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec),
    )
    still = dict.fromkeys(("position", "velocity", "effort"), np.zeros(1))
    return (
        JOINTS,
        stamp_ns,
        TYPES.make("sensor_msgs/msg/JointState", header=header, name=["mast_pan"], **still),
    )


def drive(*offsets_ns: int) -> Iterator[Event]:
    """Return a drive with a mast's message before the wheels', at these stamp differences."""
    for topic, stamp_ns, message in drive_messages(TYPES.make, STEPS * STEP_NS * 1e-9):
        if topic == JOINTS:
            yield from (mast(stamp_ns + offset_ns) for offset_ns in offsets_ns)
        yield topic, stamp_ns, message


def test_estimator_and_planner_pair_as_if_nobody_else_were_there() -> None:
    model = load_model()

    def paired(*offsets_ns: int) -> tuple[list[Observation], list[Observation], Counters]:
        pipeline, inputs = (
            Pipeline(model, configure(EstimatorConfig, TOLERANCE)),
            PlannerInputs(ROVER, configure(PlannerConfig, TOLERANCE)),
        )
        sets = [
            found
            for topic, _, message in drive(*offsets_ns)
            for found in pipeline.pair(topic, message)
        ]
        estimated = [pipeline.convert(each).observation for each in sets]
        planned = [
            found
            for topic, _, message in drive(*offsets_ns)
            for found in inputs.add(topic, message)
        ]
        return list(filter(None, estimated)), list(filter(None, planned)), pipeline.counters[JOINTS]

    *alone, counters = paired()
    assert counters == Counters(received=STEPS, paired=STEPS)
    for offset_ns in (0, 3_000_000, -3_000_000):
        *shared, counters = paired(offset_ns)
        assert counters == Counters(received=STEPS, paired=STEPS)
        for found, expected in zip(shared, alone, strict=True):
            assert len(found) == STEPS
            np.testing.assert_equal(
                [asdict(each) for each in found], [asdict(each) for each in expected]
            )
            assert np.isfinite([each.torque for each in found]).all()


def test_the_slip_source_passes_over_them_once_the_wheels_came() -> None:
    def velocity(stamp_ns: int) -> Message:
        return TYPES.make(
            "nav_msgs/msg/Odometry", header=mast(stamp_ns)[2].header, child_frame_id="base_link"
        )

    source = SlipSource(ROVER, SlipSourceConfig())
    said = [(JOINTS, message) for topic, _, message in drive(0) if topic == JOINTS]
    said += [(VELOCITY, velocity(stamp_ns)) for topic, stamp_ns, _ in drive() if topic == JOINTS]
    pairs = [
        pair.messages[0].name for topic, message in said for pair in source.pair(topic, message)
    ]
    assert [names[0] for names in pairs] == ["mast_pan", *[ROVER.wheel_names[0]] * (STEPS - 1)]
