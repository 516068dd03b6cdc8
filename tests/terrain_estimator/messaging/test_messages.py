# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Outgoing messages hold the whole update, also in words, with the same bytes live and offline."""

import math
from array import array
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState

from msg_defs.msg import MeasurementDecision, TerrainEstimate
from terrain_estimator.bags import Types
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.definitions import installed_definition
from terrain_estimator.bags.format.types import MOST_LEFT
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.messaging.messages import (
    Meta,
    Status,
    estimate_message,
    prediction_message,
    status_of,
    status_text,
    update_header,
)
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.nodes.common import message_types
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import ESTIMATE, OUTPUT_TYPES, PREDICTION, Make
from terrain_estimator.update import (
    Decision,
    Disagreement,
    Estimate,
    NamedEffect,
    Prediction,
    RowFit,
    Seconds,
    Update,
)

ROWS = ("velocity", "load", "torque_0", "torque_1", "torque_2", "acceleration")
META = Meta("a model", "ab12", "cd34", ROWS, "base_link")
TYPES = Types()


def decided(
    outcome: Outcome = Outcome.ACCEPTED, rows: tuple[str, ...] = ROWS, detail: str = ""
) -> Decision:
    """Return the decision about an observation that is a second of its own."""
    used = outcome.used
    return Decision(outcome, rows if used else (), 0.7, 36.0, 1, detail, settled=int(used))


def updated(decision: Decision | None = None, **changes: Any) -> Update:
    """Return an update with both parameters identified; ``changes`` apply to the estimate."""
    estimate = Estimate(
        mean=np.array([1500.0, 0.6]),
        covariance=np.array([[1e4, -3.0], [-3.0, 4e-4]]),
        lower_95=np.array([1304.0, 0.56]),
        upper_95=np.array([1696.0, 0.64]),
        identified=(True, True),
        mass_below_zero=0.0,
        change_probability=math.nan,
        soils=("loose_sand", "compact_sand"),
        soil_probability=(0.9, 0.1),
        effects=(NamedEffect("bulldozing", "N/m^2", 3.0, 0.5),),
        observations_used=240,
        observations_waiting=0,
        time_used_s=24.0,
        seconds=Seconds(26, 24),
    )
    prediction = Prediction(
        valid=True,
        horizon_s=0.1,
        velocity=0.15,
        variance=1e-4,
        measured=0.151,
        innovation=0.002,
        innovation_variance=1.5e-4,
    )
    return Update(
        12_500_000_001,
        7,
        estimate._replace(**changes),
        prediction,
        decision or decided(),
        1e3,
        warnings=("a warning",),
    )


def header(make: Make = TYPES.make) -> Any:
    return update_header(updated(), make, META)


def test_the_estimate_carries_numbers_stamp_and_origin() -> None:
    message = estimate_message(updated(), TYPES.make, META, header(), ("a note",))
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (
        12,
        500_000_001,
        "base_link",
    )
    assert (
        message.sequence,
        message.model_id,
        message.model_sha256,
        message.configuration_sha256,
    ) == (7, "a model", "ab12", "cd34")
    assert (message.cohesion, message.cohesion_stddev, message.tan_phi, message.tan_phi_stddev) == (
        1500.0,
        100.0,
        0.6,
        0.02,
    )
    assert (message.cohesion_lower_95, message.cohesion_upper_95) == (1304.0, 1696.0)
    assert message.covariance.tolist() == [1e4, -3.0, -3.0, 4e-4]
    assert (message.effect, message.effect_value.tolist(), message.effect_unit) == (
        ["bulldozing"],
        [3.0],
        ["N/m^2"],
    )
    assert (message.soil, message.soil_probability.tolist()) == (
        ["loose_sand", "compact_sand"],
        [0.9, 0.1],
    )
    assert message.status == Status.IDENTIFIED
    assert "a note" in message.status_text
    assert "a warning" in message.status_text
    assert message.decision.outcome_name == "ACCEPTED"
    assert message.rows == list(ROWS)


def test_the_prediction_carries_its_interval() -> None:
    message = prediction_message(updated(), TYPES.make, META, header())
    assert (message.valid, message.velocity, message.velocity_variance, message.horizon) == (
        True,
        0.15,
        1e-4,
        0.1,
    )
    assert message.velocity_upper_95 - message.velocity == pytest.approx(HALF_WIDTH_95 * 0.01)
    assert (message.measured_velocity, message.innovation, message.innovation_variance) == (
        0.151,
        0.002,
        1.5e-4,
    )


def test_a_prediction_that_is_not_valid_has_no_numbers() -> None:
    update = updated()._replace(prediction=updated().prediction._replace(valid=False))
    message = prediction_message(update, TYPES.make, META, header())
    assert not message.valid
    assert np.isnan(
        [
            message.velocity,
            message.velocity_variance,
            message.velocity_lower_95,
            message.velocity_upper_95,
        ]
    ).all()


@pytest.mark.parametrize("build", [estimate_message, prediction_message])
def test_rclpy_and_bag_classes_give_the_same_message(build: Any) -> None:
    live = serialize_message(build(updated(), message_types.make, META, header(message_types.make)))
    type_name = ESTIMATE if build is estimate_message else PREDICTION
    assert TYPES.serialize(TYPES.deserialize(live, type_name)) == TYPES.serialize(
        build(updated(), TYPES.make, META, header())
    )


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"name": ("a", "b"), "effort": np.array([1.0, 2.0])},
        {
            "header": message_types.make("std_msgs/msg/Header", frame_id="body"),
            "name": ("a", "b"),
            "position": [1.0, 2.0],
            "velocity": np.array([3.0, 4.0]),
            "effort": (),
        },
    ],
    ids=["none", "some", "all"],
)
def test_a_message_of_rclpy_is_what_its_class_makes_of_the_fields(fields: dict[str, Any]) -> None:
    made = message_types.make("sensor_msgs/msg/JointState", **fields)
    own = JointState(
        **{
            name: value if name == "header" else [*value] if name == "name" else array("d", value)
            for name, value in fields.items()
        }
    )
    assert made == own
    assert repr(made) == repr(own)  # with the kinds of its arrays
    assert serialize_message(made) == serialize_message(own)
    made.name, own.name = ["c"], ["c"]
    assert made == own


def test_a_message_of_rclpy_shares_no_array_with_what_it_was_made_of() -> None:
    imu = {name: getattr(Imu(), name) for name in Imu.get_fields_and_field_types()}
    covariance = np.ones(9)
    made = message_types.make(
        "sensor_msgs/msg/Imu", **(imu | {"orientation_covariance": covariance})
    )
    covariance[:] = 2.0
    assert made.orientation_covariance.tolist() == [1.0] * 9
    whole = message_types.make("sensor_msgs/msg/Imu", **(imu | {"orientation_covariance": [1] * 9}))
    assert serialize_message(whole) == serialize_message(made)


@pytest.mark.parametrize("joints", [0, 1, 2, 3])
def test_bytes_that_rclpy_leaves_after_empty_sequences_are_no_fault(joints: int) -> None:
    sent = JointState(name=["j"] * joints, position=[0.5] * joints)
    types = Types()
    types.add(installed_definition("sensor_msgs/msg/JointState"))
    read = types.deserialize(serialize_message(sent), "sensor_msgs/msg/JointState")
    assert (list(read.name), list(read.position)) == (list(sent.name), list(sent.position))
    assert len(read.velocity) == len(read.effort) == 0
    with pytest.raises(BagError, match="are not a sensor_msgs/msg/JointState"):
        types.deserialize(serialize_message(sent) + bytes(MOST_LEFT), "sensor_msgs/msg/JointState")


def test_the_constants_are_those_of_the_message_definitions() -> None:
    assert {status.name: status.value for status in Status} == {
        status.name: getattr(TerrainEstimate, status.name) for status in Status
    }
    assert {each.name: each.value for each in Outcome} == {
        each.name: getattr(MeasurementDecision, each.name) for each in Outcome
    }
    assert set(OUTPUT_TYPES.values()) == {ESTIMATE, PREDICTION}


@pytest.mark.parametrize(
    ("update", "status", "word"),
    [
        (updated(), Status.IDENTIFIED, "identified"),
        (updated(identified=(False, True)), Status.CONVERGING, "not identified yet: cohesion"),
        (updated(identified=(False, False), observations_used=0), Status.PRIOR_ONLY, "prior only"),
        (updated(decided(Outcome.STANDSTILL)), Status.STANDING_STILL, "standing still"),
        (
            updated(decided(Outcome.NOT_FINITE, detail="velocity is nan")),
            Status.DEGRADED,
            "velocity is nan",
        ),
        (
            updated(decided(rows=("velocity", "load"))),
            Status.DEGRADED,
            "rows missing: torque_0, torque_1, torque_2, acceleration",
        ),
        (updated(mass_below_zero=0.2), Status.IDENTIFIED, "20% of the posterior is below zero"),
    ],
)
def test_the_status_says_what_is_missing(update: Update, status: Status, word: str) -> None:
    assert status_of(update, ROWS) is status
    assert word in status_text(update, status, ROWS, ())


@pytest.mark.parametrize("outcome", [Outcome.ACCEPTED, Outcome.STANDSTILL, Outcome.GATED])
def test_a_model_that_does_not_fit_is_the_status_and_is_named_first(outcome: Outcome) -> None:
    reasons = (Disagreement("the model does not fit", "check the model"),)
    disagreeing = updated(decided(outcome, detail="a wild row"))._replace(disagreements=reasons)
    status = status_of(disagreeing, ROWS)
    assert status is Status.DISAGREES
    text = status_text(disagreeing, status, ROWS, ())
    assert text.startswith(
        "disagrees; the model does not fit; check the model; c and tan phi are the prior's"
    )
    assert "not identified yet" not in text
    assert f"{outcome.name}: a wild row" in text


def test_an_estimate_that_no_fit_confirms_says_so() -> None:
    sharp = updated(identified=(False, False))._replace(unconfirmed="the last 20 seconds are odd")
    status = status_of(sharp, ROWS)
    assert status is Status.CONVERGING
    text = status_text(sharp, status, ROWS, ())
    assert "not identified yet: the model is not confirmed: the last 20 seconds are odd" in text


def test_the_messages_tell_what_became_of_the_seconds() -> None:
    decision = decided(Outcome.GATED)._replace(settled=9)
    told = updated(decision, observations_waiting=3)
    message = estimate_message(told, TYPES.make, META, header())
    assert (message.observations_used, message.observations_waiting) == (240, 3)
    assert (message.seconds_judged, message.seconds_taken) == (26, 24)
    assert message.decision.settled == 9


def test_the_fit_of_the_rows_is_told() -> None:
    fit = (RowFit("velocity", 0.25, 1.5), RowFit("load", -0.5, 0.75))
    message = estimate_message(updated(fit=fit), TYPES.make, META, header())
    assert message.fit_row == ["velocity", "load"]
    assert list(message.fit_offset) == [0.25, -0.5]
    assert list(message.fit_spread) == [1.5, 0.75]


@pytest.mark.parametrize(
    ("config", "rows"),
    [
        (CoreConfig(), (*ROWS, "moment", "bogie_moment")),
        (
            CoreConfig(use_torque=False),
            ("velocity", "load", "acceleration", "moment", "bogie_moment"),
        ),
        (CoreConfig(use_imu=False, use_moments=False), ROWS[:-1]),
    ],
)
def test_a_row_that_is_switched_off_is_not_missing(
    config: CoreConfig, rows: tuple[str, ...]
) -> None:
    wanted = usable_rows((*ROWS, "moment", "bogie_moment"), config)
    assert wanted == rows
    assert status_of(updated(decided(rows=rows)), wanted) is Status.IDENTIFIED
