# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A saved state is judged as numbers, and nothing unsound is ever published, whatever the state.

`make faults` runs thousands of hostile states; 60 and 40 run here.
"""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.restored_state import EstimatorParts, _check_range
from terrain_estimator.estimator.saved_state import StateFileError
from terrain_estimator.estimator.soundness import unsound, unsound_answer
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packing import view_of
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.outcome import Outcome
from tests.faults.states import Saved, refused_honest, run
from tests.terrain_estimator.drives import drive_observations

SEED = 20
HOSTILE, HONEST = 60, 40


def a_second(misfit: float, degrees: float, miss: float = np.nan) -> Floats:
    """Return one kept second [1, 18], every row of which missed by ``miss``."""
    return np.array([[misfit, degrees, *[miss] * 16]])


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture(scope="module")
def drive(model: LoadedModel) -> list[Observation]:
    return drive_observations(model.rover, model.metadata.soils[0], 4.0, seed=2)


@pytest.fixture(scope="module")
def saved(model: LoadedModel, drive: list[Observation]) -> Saved:
    estimator = Estimator(model, CoreConfig())
    for observation in drive[:25]:
        estimator.update(observation)
    return estimator.save()


def test_hostile_states_are_refused_or_harmless(model: LoadedModel) -> None:
    """With 60 states, a share of harmful ones above 4.9 % is found with 95 % probability."""
    result = run(model, HOSTILE, SEED)
    assert result.wrong == []
    assert result.refused.total() > 0.8 * HOSTILE


@pytest.mark.parametrize("seed", [SEED, SEED + 1])
def test_every_state_of_a_hostile_drive_is_taken(model: LoadedModel, seed: int) -> None:
    assert refused_honest(model, seed, HONEST // 2) == []


def full(value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda array: np.full_like(array, value)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("state.strength_covariance", full(0.0), r"strength_covariance is 0, but its hypotheses"),
        ("state.covariance", full(1e308), r"covariance is 1e\+308, not within -1e\+30 to 1e\+30"),
        ("state.covariance", full(5e-324), r"covariance is 4.94066e-324, but its hypotheses give"),
        ("state.constants", full(np.nan), "constants is nan, not finite"),
        ("state.weight", lambda array: 2.0 * array, "weight is .*, but its hypotheses give"),
        ("state.precision", lambda array: -array, "precision is no matrix, not symmetric"),
        ("state.mean", lambda array: array + 1e4, "mean of parameter 0 is .* more than 100"),
        ("state.soils", lambda array: array[:1], r"soils is float64 \(1,\), the model's"),
        ("state.log_weight", lambda array: array[:1], "log_weight is float64"),
        ("state.kind", lambda array: array + 99, "kind is .*, not within 0 to 5"),
        ("state.velocity", lambda array: array.astype(">f8"), r"velocity is >f8 \(\)"),
        ("state.block", lambda array: 1e6 * array, "block has a row 0 with"),
        ("counts", lambda array: array - 2**62, "stamp is .*, not within -1"),
        (
            "counts",
            lambda array: array + np.eye(len(array), dtype=int)[2],
            "waiting is .*, but the open block has",
        ),
        (
            "counts",
            lambda array: array + 10 * np.eye(len(array), dtype=int)[5],
            "alone is 10, not within 0 to 9",
        ),
        ("numbers", full(np.nan), "time_used is nan, not within"),
        (
            "numbers",
            lambda array: array + 2.0 * np.eye(len(array))[12],
            "moving_weight is .*, not within",
        ),
        (
            "numbers",
            lambda array: array + 60.0 * np.eye(len(array))[16],
            "past_weight is .*, not within",
        ),
        (
            "numbers",
            lambda array: array - 1e9 * np.eye(len(array))[13],
            "past_distance is .*, not within",
        ),
        ("window", lambda array: array + 2, r"window is \[.*\], not within 0 to \[1, 10, 10\]"),
        ("window", lambda array: array - 1, r"window is \[.*\], not within 0 to \[1, 10, 10\]"),
        ("window", lambda array: np.tile(array, (61, 1)), "window is missing or has another shape"),
        ("since_change", lambda array: array + 99, "since_change is 144, not within 0 to 45"),
        ("since_change", lambda _: np.zeros(2), "since_change is missing or has another shape"),
        (
            "numbers",
            lambda array: array + 1.0 * np.eye(len(array))[17],
            "way is 3, not within 0 to 2",
        ),
        (
            "numbers",
            lambda array: array + 1.0 * np.eye(len(array))[18],
            "same_way is 4, not within 0 to 3",
        ),
        ("judged", lambda _: np.zeros((301, 2)), "judged is missing or has another shape"),
        ("pending", lambda _: np.zeros(2), "pending is missing or has another shape"),
        ("judged", lambda _: np.zeros((301, 18)), "judged is missing or has another shape"),
        ("pending", lambda _: a_second(np.nan, 7.0), r"pending is \[\[nan, 7.0\]\], no misfits"),
        ("pending", lambda _: a_second(7.0, 6.5), r"pending is \[\[7.0, 6.5\]\], no misfits"),
        ("judged", lambda _: a_second(7.0, 1e9), r"judged is .*, no misfits with their"),
        ("judged", lambda _: a_second(7.0, 0.0), r"judged is .*, no misfits with their"),
        ("judged", lambda _: a_second(7.0, 7.0, -np.inf), "judged is -inf, no innovation of a row"),
        (
            "judged",
            lambda _: a_second(7.0, 7.0, 1e200),
            r"judged is 1e\+200, no innovation of a row",
        ),
        ("last.slip", full(np.inf), "last observation has axle 0: slip is inf"),
        ("last.slip", lambda array: array[:1], r"last slip is float64 \(1,\), another version's"),
    ],
)
def test_a_refusal_names_the_field_and_its_value(
    model: LoadedModel,
    saved: Saved,
    name: str,
    change: Callable[[np.ndarray], np.ndarray],
    words: str,
) -> None:
    estimator = Estimator(model, CoreConfig())
    before = {key: value.tobytes() for key, value in estimator.save().items()}
    with pytest.raises(StateFileError, match=f"the state's {words}.*: start without it, from"):
        estimator.restore(saved | {name: change(saved[name])})
    assert {key: value.tobytes() for key, value in estimator.save().items()} == before


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("velocity", -1e6, 1e6),
        ("velocity_variance", 1e-60, 1e30),
        ("acceleration_variance", 0.0, 1e30),
        ("feature_noise", 0.0, 1e30),
        ("change", 0.0, 1e30),
        ("change_weight", 0.0, 1.0),
        ("closed", 0.0, 1.0),
        ("changed", 0.0, 1.0),
        ("age", 0.0, 1e12),
        ("precision", -1e30, 1e30),
    ],
)
def test_a_number_of_a_state_has_its_range(
    model: LoadedModel, name: str, least: float, most: float
) -> None:
    runtime = model.runtime
    start = runtime.arrays(runtime.initial())
    parts = EstimatorParts(
        start, start, lambda state, _: state, model.rows, 3, by_wheel=False, wheel_radius_m=0.13,
        block=10, step_s=0.1,
    )  # fmt: skip
    for value in (least, most):
        _check_range(name, np.array([value, most]), parts)
        beyond = value + math.copysign(1e-6 + 1e-3 * abs(value), value - 0.5 * (least + most))
        with pytest.raises(StateFileError, match=f"the state's {name} is .*, not within"):
            _check_range(name, np.array([most, beyond]), parts)


@pytest.mark.parametrize(
    ("part", "value", "words"),
    [
        ("torque", 1e13, ""),
        ("torque", 1.5e13, "a torque of"),
        ("step", 0.25, ""),
        ("step", 0.26, "step 0.26, linked 1"),
        ("step", -0.01, "step -0.01"),
        ("linked", 0.5, "linked 0.5"),
    ],
)
def test_an_open_second_holds_what_can_be_measured(
    model: LoadedModel, saved: Saved, part: str, value: float, words: str
) -> None:
    block = torch.from_numpy(saved["state.block"].copy())
    getattr(view_of(block, model.rover.axles), part)[2] = value
    arrays = saved | {"state.block": block.numpy()}
    if not words:
        Estimator(model, CoreConfig()).restore(arrays)
        return
    with pytest.raises(StateFileError, match=words):
        Estimator(model, CoreConfig()).restore(arrays)


def test_a_precision_is_symmetric_but_for_rounding(model: LoadedModel, saved: Saved) -> None:
    def skewed(by: float) -> Saved:
        precision = saved["state.precision"].copy()
        root = np.sqrt(precision[0, 0, 0] * precision[0, 1, 1])
        precision[0, 0, 1] += by * root
        return saved | {"state.precision": precision}

    with pytest.raises(StateFileError, match="precision is no matrix, not symmetric"):
        Estimator(model, CoreConfig()).restore(skewed(2e-4))
    Estimator(model, CoreConfig()).restore(skewed(1e-9))


@pytest.mark.parametrize(("by", "taken"), [(1.3e-4, True), (2.1e-4, False)])
def test_a_derived_number_may_differ_by_a_ten_thousandth_of_one_and_its_size(
    model: LoadedModel, saved: Saved, by: float, *, taken: bool
) -> None:
    soils = saved["state.soils"].copy()
    largest = soils.argmax()
    assert soils[largest] > 0.4
    soils[largest] -= by
    estimator = Estimator(model, CoreConfig())
    if taken:
        estimator.restore(saved | {"state.soils": soils})
        return
    with pytest.raises(StateFileError, match=r"soils is .*, but its hypotheses give"):
        estimator.restore(saved | {"state.soils": soils})


def test_a_saved_stamp_of_zero_is_one(model: LoadedModel, saved: Saved) -> None:
    counts = saved["counts"].copy()
    counts[0] = 0
    estimator = Estimator(model, CoreConfig())
    estimator.restore(saved | {"counts": counts})
    assert estimator.last_stamp_ns == 0


def test_a_second_has_no_more_than_a_thousand_degrees_of_freedom(
    model: LoadedModel, saved: Saved
) -> None:
    Estimator(model, CoreConfig()).restore(saved | {"judged": a_second(9.0, 1e3)})
    with pytest.raises(StateFileError, match="no misfits with their degrees"):
        Estimator(model, CoreConfig()).restore(saved | {"judged": a_second(9.0, 1001.0)})


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0, 5e-324, 1e308])
@pytest.mark.parametrize("part", ["strength_mean", "strength_covariance", "precision", "velocity"])
def test_whatever_is_in_the_state_nothing_unsound_is_published(
    model: LoadedModel, drive: list[Observation], part: str, value: float
) -> None:
    """The state is spoilt behind the judgement, which is therefore not what helps."""
    estimator = Estimator(model, CoreConfig())
    for observation in drive[:15]:
        estimator.update(observation)
    estimator._state[part] = torch.full_like(estimator._state[part], value)
    if part.startswith("strength"):
        estimator._summarise()
    updates = [estimator.update(observation) for observation in drive[15:40]]
    for each in updates:
        assert unsound(each.estimate) == ""
        assert unsound_answer(each.estimate, each.prediction) == ""
    if part == "strength_covariance":
        first = updates[0]
        assert first.decision.outcome is Outcome.NUMERICAL_FAILURE
        assert "it is not published, and the prior holds again" in first.decision.detail
        assert estimator.reopened == 1


def test_an_unsound_number_is_named(model: LoadedModel, drive: list[Observation]) -> None:
    update = Estimator(model, CoreConfig()).update(drive[0])
    estimate, prediction = update.estimate, update.prediction
    for spoilt, words in (
        (estimate._replace(mean=np.array([np.nan, 1.0])), "mean is nan, 1"),
        (estimate._replace(covariance=np.array([[1.0, 1.0], [1.0, 1.0]])), "not symmetric and pos"),
        (estimate._replace(covariance=np.array([[1.0, 0.1], [0.2, 1.0]])), "not symmetric and pos"),
        (estimate._replace(mass_below_zero=1.5), "a probability is outside 0 to 1: "),
    ):
        assert words in unsound(spoilt)
    improbable = estimate._replace(change_probability=1.5)
    assert unsound_answer(improbable, prediction) == "a probability is outside 0 to 1: 1.5"
    negative = prediction._replace(valid=True, velocity=0.0, variance=-1.0)
    assert unsound_answer(estimate, negative) == "velocity_variance is -1"


@pytest.mark.parametrize(
    ("mean", "sd", "words"),
    [
        (1e-200, 1e-200, "the prior's "),
        (1000.0, 1e-200, "a deviation is too small or too large "),
    ],
)
def test_a_prior_without_a_sound_estimate_is_refused(
    model: LoadedModel, mean: float, sd: float, words: str
) -> None:
    values = {"prior.cohesion_mean": mean, "prior.cohesion_sd": sd}
    with pytest.raises(ConfigError, match=rf"parameters prior\.\*: {words}"):
        Estimator(model, configure(CoreConfig, values))
