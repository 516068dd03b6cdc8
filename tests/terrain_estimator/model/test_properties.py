# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Properties of conversion, screening and posterior for every possible input."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig, EstimatorConfig
from terrain_estimator.estimator.off_plane import DEVIATIONS, FASTEST
from terrain_estimator.estimator.screening import screen
from terrain_estimator.messaging.conversion import Conversion, Converter
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.gaussian import cholesky, mixture, project, random_walk
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import AXLE_FIELDS, SCALAR_FIELDS, Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import INPUT_TYPES
from terramechanics.presets import load_rover
from tests.soundness import unsound
from tests.terrain_estimator.estimator.test_screening import observe

ROVER = load_rover("mars_rover")
ANY = st.floats(width=64)
TYPES = Types()


@st.composite
def observations(draw: st.DrawFn, step: int = 0) -> Observation:
    """A sound observation, of which some values are anything."""
    names = draw(st.lists(st.sampled_from([*AXLE_FIELDS, *SCALAR_FIELDS]), max_size=4, unique=True))
    changes: dict[str, Any] = {
        name: draw(ANY if name in SCALAR_FIELDS else arrays(np.float64, 3, elements=ANY))
        for name in names
    }
    return observe(stamp_ns=10**9 + step * 10**8, **changes)


@given(observation=observations(), previous_ns=st.none() | st.integers(0, 2 * 10**9))
def test_what_passes_the_screening_can_be_calculated_with(
    observation: Observation, previous_ns: int | None
) -> None:
    verdict = screen(observation, previous_ns, ROVER, CoreConfig())
    assert bool(verdict.detail) == (verdict.outcome is not Outcome.ACCEPTED)
    if not verdict.outcome.used:
        return
    passed = verdict.observation
    assert abs(passed.velocity) <= FASTEST
    assert math.isfinite(passed.pitch)
    wheels = np.isfinite(passed.slip)
    assert wheels.any()
    assert (wheels == np.isfinite(passed.sinkage)).all()
    for name in ("slip", "sinkage", "contact_angle"):
        deviation = getattr(passed, f"{name}_sd")[wheels]
        assert ((deviation >= DEVIATIONS[0]) & (deviation <= DEVIATIONS[1])).all()
    optional = [*passed.torque, *passed.wheel_rate, passed.acceleration, passed.bogie_angle]
    assert not np.isinf(optional).any()
    again = screen(passed, previous_ns, ROVER, CoreConfig())
    for name in (*AXLE_FIELDS, *SCALAR_FIELDS):
        np.testing.assert_array_equal(getattr(again.observation, name), getattr(passed, name))


@pytest.fixture(scope="module")
def pipeline() -> Pipeline:
    return Pipeline(load_model(), EstimatorConfig())


def test_no_sequence_of_observations_makes_a_posterior_unsound(pipeline: Pipeline) -> None:
    @settings(max_examples=max(1, settings().max_examples // 12))
    @given(drive=st.tuples(*(observations(step) for step in range(12))))
    def attempt(drive: tuple[Observation, ...]) -> None:
        pipeline.reset()
        for observation in drive:
            answer = pipeline.answer(Conversion(observation.stamp_ns, observation))
            assert [
                text
                for message in answer.messages(TYPES.make, pipeline.meta).values()
                for text in unsound(message)
            ] == []

    attempt()


NAMES = st.lists(
    st.sampled_from([*ROVER.wheel_names, "", "bogie", "foreign"]), max_size=8
) | st.just(list(ROVER.wheel_names))
VALUES = st.lists(ANY, max_size=8) | st.lists(ANY, min_size=6, max_size=6)


@settings(max_examples=max(1, settings().max_examples // 4))
@given(data=st.data())
def test_a_set_of_messages_of_any_form_is_an_observation_or_a_refusal(data: st.DataObject) -> None:
    draw = data.draw
    slip = TYPES.make(
        INPUT_TYPES["wheel_slip"], wheel=draw(NAMES), slip=draw(VALUES), slip_stddev=draw(VALUES)
    )
    fields = ("sinkage", "sinkage_stddev", "contact_angle", "contact_angle_stddev")
    sinkage = TYPES.make(
        INPUT_TYPES["wheel_sinkage"], wheel=draw(NAMES), **{name: draw(VALUES) for name in fields}
    )
    joints = TYPES.make(
        INPUT_TYPES["joint_states"],
        name=draw(NAMES),
        **{name: draw(VALUES) for name in ("position", "velocity", "effort")},
    )
    odom, imu = TYPES.make(INPUT_TYPES["odom"]), TYPES.make(INPUT_TYPES["imu"])
    odom.twist.twist.linear.x, odom.twist.covariance[0], odom.pose.pose.orientation.w = (
        draw(ANY),
        draw(ANY),
        draw(ANY),
    )
    imu.orientation.y, imu.orientation_covariance[4], imu.linear_acceleration.x = (
        draw(ANY),
        draw(ANY),
        draw(ANY),
    )
    messages = (
        slip,
        sinkage,
        odom,
        draw(st.sampled_from([None, joints])),
        draw(st.sampled_from([None, imu])),
    )
    converter = Converter(
        ROVER, dataclasses.replace(ConversionConfig(), body_frame=""), CoreConfig()
    )
    found = converter.convert(5, messages)
    if found.observation is None:
        assert found.outcome is Outcome.WRONG_WHEELS
        assert "wheels" in found.detail
    else:
        screen(found.observation, None, ROVER, CoreConfig())


@given(
    matrix=arrays(np.float64, (2, 4, 4), elements=ANY),
    mean=arrays(np.float64, (2, 4), elements=ANY),
    weight=arrays(np.float64, 2, elements=ANY),
)
def test_gaussians_of_any_numbers_give_definite_matrices_or_nan(
    matrix: np.ndarray[Any, Any], mean: np.ndarray[Any, Any], weight: np.ndarray[Any, Any]
) -> None:
    """They never raise, and no covariance is indefinite: a caller asks for finite numbers only."""
    precision = torch.from_numpy(matrix) @ torch.from_numpy(matrix).mT
    factor = cholesky(precision)
    for one in factor:
        assert bool(torch.isfinite(one).all()) <= bool((torch.diagonal(one) > 0.0).all())
    _, covariance = project(torch.from_numpy(mean), precision, torch.eye(2, 4, dtype=torch.float64))
    torch.testing.assert_close(covariance, covariance.mT, rtol=0.0, atol=0.0, equal_nan=True)
    mixture(torch.from_numpy(weight), torch.from_numpy(mean)[:, :2], covariance)
    walked = random_walk(precision, torch.from_numpy(np.abs(weight)))
    torch.testing.assert_close(walked, walked.mT, rtol=0.0, atol=0.0, equal_nan=True)
