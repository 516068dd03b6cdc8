# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What is forgotten of long drives whose rows tell the soil constants little, and what is not."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, TORCHSCRIPT, CoreConfig
from terrain_estimator.estimator import memory as module
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.observation import Observation
from terramechanics.presets import load_soil
from tests.terrain_estimator.drives import drive_observations

WITHOUT = CoreConfig(use_torque=False, use_moments=False)
SECONDS = 30.0
Estimates = NDArray[np.float64]


@pytest.fixture(scope="module")
def drive() -> list[Observation]:
    """A drive of the paper's rover."""
    rover = load("paper_rover", AUTO).model.rover
    return drive_observations(rover, load_soil("loose_sand"), SECONDS, 3)


def started(config: CoreConfig, backend: str = AUTO) -> Estimator:
    return Estimator(load("paper_rover", backend).model, config)


def estimates(
    estimator: Estimator,
    drive: list[Observation],
    change: Callable[[Observation], Observation] = lambda each: each,
) -> Estimates:
    """Return mean and covariance of (c, tan phi) after each observation [T, 3, 2]."""
    found = [estimator.update(change(each)).estimate for each in drive]
    return np.array([[each.mean, *each.covariance] for each in found])


@pytest.mark.parametrize("config", [CoreConfig(), CoreConfig(use_torque=False)])
def test_nothing_is_forgotten_while_torques_or_moments_are_there(
    monkeypatch: pytest.MonkeyPatch, drive: list[Observation], config: CoreConfig
) -> None:
    whole = estimates(started(config), drive)
    monkeypatch.setattr(module, "MEMORY_S", 5.0)
    assert np.array_equal(estimates(started(config), drive), whole)


def test_velocity_and_load_are_forgotten_after_that_time_and_not_before(
    monkeypatch: pytest.MonkeyPatch, drive: list[Observation]
) -> None:
    whole = estimates(started(WITHOUT), drive)
    monkeypatch.setattr(module, "MEMORY_S", 10.0)
    short = estimates(started(WITHOUT), drive)
    same = (short == whole).all((1, 2))
    first = int(np.argmin(same))
    assert same[:first].all()
    assert 100 <= first <= 111  # the first second that ends after 10 s of driving
    wider = np.sqrt(short[-1, [1, 2], [0, 1]] / whole[-1, [1, 2], [0, 1]])
    assert (wider > 1.1).all()
    assert (wider < 3.0).all()


def test_torques_and_bogie_angles_that_the_messages_lack_count_as_well(
    monkeypatch: pytest.MonkeyPatch, drive: list[Observation]
) -> None:
    monkeypatch.setattr(module, "MEMORY_S", 10.0)

    def without(each: Observation) -> Observation:
        nothing = np.full_like(each.torque, np.nan)
        return dataclasses.replace(
            each, torque=nothing, bogie_angle=np.nan, acceleration=np.nan, acceleration_sd=np.nan
        )

    off = dataclasses.replace(WITHOUT, use_imu=False)
    found = estimates(started(CoreConfig()), drive, without)
    assert found == pytest.approx(estimates(started(off), drive), rel=1e-9)


def test_what_is_forgotten_for_long_enough_is_the_prior(drive: list[Observation]) -> None:
    estimator = started(WITHOUT)
    prior = estimates(estimator, drive[:1])[0]
    learnt = estimates(estimator, drive[1:])[-1]
    assert (learnt.diagonal(-1) < 0.5 * prior.diagonal(-1)).all()
    runtime, state, memory = estimator._runtime, estimator._state, estimator._memory
    gone = runtime.estimate(memory.faded(runtime, state, 1e9))
    # its part below zero counts at the start alone
    assert gone == pytest.approx(prior, rel=0.02, abs=1e-6)


def test_half_a_minute_twice_is_a_minute_once(drive: list[Observation]) -> None:
    estimator = started(WITHOUT)
    estimates(estimator, drive)
    runtime, state, memory = estimator._runtime, estimator._state, estimator._memory
    once = memory.faded(runtime, state, 60.0)
    twice = memory.faded(runtime, memory.faded(runtime, state, 30.0), 30.0)
    assert runtime.estimate(twice) == pytest.approx(runtime.estimate(once), rel=1e-9)
    assert not np.allclose(runtime.estimate(once), runtime.estimate(state), rtol=0.01)


def test_a_saved_state_forgets_like_one_that_never_stopped(
    monkeypatch: pytest.MonkeyPatch, drive: list[Observation]
) -> None:
    monkeypatch.setattr(module, "MEMORY_S", 10.0)
    whole = estimates(started(WITHOUT), drive)
    first, second = started(WITHOUT), started(WITHOUT)
    estimates(first, drive[:155])
    second.restore(first.save())
    assert np.array_equal(estimates(second, drive[155:]), whole[155:])


def test_torchscript_and_the_compiled_core_forget_alike(
    monkeypatch: pytest.MonkeyPatch, drive: list[Observation]
) -> None:
    monkeypatch.setattr(module, "MEMORY_S", 10.0)
    found = [estimates(started(WITHOUT, each), drive[:200]) for each in (AUTO, TORCHSCRIPT)]
    assert found[0] == pytest.approx(found[1], rel=1e-6)


def test_a_soil_that_the_prior_excludes_stays_excluded(
    monkeypatch: pytest.MonkeyPatch, drive: list[Observation]
) -> None:
    monkeypatch.setattr(module, "MEMORY_S", 10.0)
    estimator = started(dataclasses.replace(WITHOUT, prior_soil="loose_sand"))
    assert np.isfinite(estimates(estimator, drive)).all()
    assert estimator.update(drive[-1]).estimate.soil_probability[0] == 1.0
