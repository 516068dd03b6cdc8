# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Published messages are sound for any input: a share of `make million`, and its judge."""

import copy
import math
from typing import Any

import numpy as np
import pytest

from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.outcome import Outcome
from tests.faults.million import run
from tests.soundness import unsound
from tests.terrain_estimator.drives import drive_observations

UPDATES = 300


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


def test_mad_sensors_and_clocks_never_make_an_output_unsound(model: LoadedModel) -> None:
    result = run(model, UPDATES, seed=1000, longest=20)
    assert result.unsound == []
    assert result.updates == UPDATES
    assert result.least > 0.0
    # otherwise the inputs were too sound for a test
    assert {
        Outcome.ACCEPTED,
        Outcome.ACCEPTED_PARTIALLY,
        Outcome.GATED,
        Outcome.BAD_DEVIATION,
    } <= set(result.outcomes)


@pytest.fixture(scope="module")
def messages(model: LoadedModel) -> dict[str, Any]:
    """Return the messages of the last of some sound observations; the first has no prediction."""
    pipeline = Pipeline(model, EstimatorConfig())
    drive = drive_observations(model.rover, model.metadata.soils[0], 0.5, seed=1)
    *_, answer = [pipeline.answer(Conversion(each.stamp_ns, each)) for each in drive]
    outgoing: dict[str, Any] = answer.messages(Types().make, pipeline.meta)
    assert outgoing["motion_prediction"].valid
    assert [text for message in outgoing.values() for text in unsound(message)] == []
    return outgoing


@pytest.mark.parametrize(
    ("topic", "field", "value", "words"),
    [
        ("terrain_estimate", "cohesion", math.nan, "cohesion is nan"),
        ("terrain_estimate", "tan_phi_upper_95", math.inf, "tan_phi_upper_95 is inf"),
        ("terrain_estimate", "covariance", np.array([1.0, 0.5, 0.5 + 1e-16, 1.0]), "not symmetric"),
        ("terrain_estimate", "covariance", np.array([1.0, 1.0, 1.0, 1.0]), "not positive definite"),
        ("terrain_estimate", "cohesion_lower_95", -1.0, "interval of cohesion"),
        ("terrain_estimate", "change_probability", 1.0 + 1e-15, "probabilities"),
        ("motion_prediction", "velocity_variance", 0.0, "velocity_variance is 0.0"),
        ("motion_prediction", "velocity", math.nan, "velocity is nan"),
        ("motion_prediction", "innovation", math.inf, "innovation is inf"),
    ],
)
def test_the_judge_sees_what_is_unsound(
    messages: dict[str, Any], topic: str, field: str, value: Any, words: str
) -> None:
    message = copy.deepcopy(messages[topic])
    setattr(message, field, value)
    assert any(words in text for text in unsound(message))
