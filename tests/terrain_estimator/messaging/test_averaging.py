# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Readings of any rate reach the estimator at 10 Hz, and those at 10 Hz as they are."""

import dataclasses
import math
from collections.abc import Callable, Iterable
from functools import cache

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.estimator.screening import screen
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.messaging.averaging import Averager, RateCounts, Treatment, averaged
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.pipeline import Answer, Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import AXLE_FIELDS, SCALAR_FIELDS, Floats, Observation
from terrain_estimator.outcome import Outcome
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import Sample
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import start
from terramechanics.terrain.ground import Ground
from tests.rovers import MARS

START_NS = 7_000_000_000
PIPELINE = cache(lambda: Pipeline(load_model(), EstimatorConfig()))


@cache
def drive(rate_hz: int, seconds: float, seed: int = 1) -> list[Observation]:
    """Return the readings of one simulated drive at a rate."""
    rover, generator = load_rover("mars_rover"), torch.Generator().manual_seed(seed)
    ground = Ground.constant(load_soil("loose_sand"))
    simulation, schedule = start(rover, ground, "S1", generator, 1, "", 1.0 / rate_hz, None)
    readings = []
    for step in range(1, round(seconds * rate_hz) + 1):
        sample = simulation.step(schedule.kind, schedule.command(step / rate_hz))
        measured = measure_drive(rover, _with_time(sample), Noise(), generator)
        [reading] = observations_of(measured, 0)
        stamp_ns = START_NS + round(step * 1e9 / rate_hz)
        readings.append(dataclasses.replace(reading, stamp_ns=stamp_ns))
    return readings


def _with_time(sample: Sample) -> Sample:
    names = [field.name for field in dataclasses.fields(Sample)]
    return Sample(**{name: getattr(sample, name).unsqueeze(1) for name in names})


def beforehand(readings: list[Observation], each: int) -> list[Observation]:
    """Return means of ``each`` readings, as a user would make them: sd sqrt(SUM sd^2) / n."""
    means = []
    for at in range(0, len(readings) - each + 1, each):
        part = readings[at : at + each]
        columns = {
            name: np.array([getattr(reading, name) for reading in part])
            for name in (*AXLE_FIELDS, *SCALAR_FIELDS)
        }
        values = {
            name: np.linalg.norm(column, axis=0) / each if name.endswith("_sd") else column.mean(0)
            for name, column in columns.items()
        }
        scalars = {name: float(values[name]) for name in SCALAR_FIELDS}
        means.append(Observation(part[-1].stamp_ns, **(values | scalars)))
    return means


def through(readings: Iterable[Observation]) -> list[Answer]:
    """Return the answers to readings, up to the end of the input."""
    pipeline = PIPELINE()
    pipeline.reset()
    taken = [
        each
        for reading in readings
        for each in pipeline.average(Conversion(reading.stamp_ns, reading))
    ]
    return [pipeline.answer(each) for each in (*taken, *pipeline.rest_of_means())]


def estimates(answers: list[Answer]) -> Floats:
    return np.array(
        [[*each.update.estimate.mean, *each.update.estimate.covariance.ravel()] for each in answers]
    )


@pytest.mark.parametrize("each", [2, 5, 20])
def test_fast_readings_give_the_estimate_of_their_means_made_beforehand(each: int) -> None:
    readings = drive(10 * each, 1.5)
    first, *own = through(readings)
    other = through(beforehand(readings, each))
    assert (
        first.update.stamp_ns == readings[0].stamp_ns
    )  # it was answered before the rate was known
    assert [answer.update.stamp_ns for answer in own] == [
        reading.stamp_ns for reading in readings[each - 1 :: each]
    ]
    np.testing.assert_allclose(estimates(own), estimates(other), rtol=1e-9)
    counts = [answer.update.estimate for answer in own]
    assert [each.observations_used for each in counts] == [*9 * [0], *6 * [10]]
    assert [each.observations_waiting for each in counts] == [*range(1, 10), *range(6)]
    assert own[-1].notes == (f"mean of {each} readings at {10 * each} Hz",)


def taken(
    stamps_s: NDArray[np.floating], usable: Callable[[int], bool] = lambda _: True
) -> list[Conversion]:
    """Return what the estimator takes of equal readings at these times."""
    pipeline, [model] = PIPELINE(), drive(10, 0.1)
    pipeline.reset()
    result = []
    for at, time_s in enumerate(stamps_s):
        velocity = model.velocity if usable(at) else math.nan
        reading = dataclasses.replace(
            model, stamp_ns=START_NS + round(time_s * 1e9), velocity=velocity
        )
        result += pipeline.average(Conversion(reading.stamp_ns, reading))
    return [*result, *pipeline.rest_of_means()]


def test_10_hz_with_jitter_and_losses_passes_as_it_is() -> None:
    """40 drives; jitter of up to +-30 ms uniform, 15 ms normal, and 30 % of the messages lost."""
    for seed in range(40):
        draw = np.random.default_rng(seed)
        grid = np.arange(1, 301) * 0.1
        jitter = draw.uniform(-0.03, 0.03, 300) if seed % 2 else draw.normal(0.0, 0.015, 300)
        times = (grid + jitter)[draw.random(300) > (0.3 if seed % 4 < 2 else 0.0)]
        result = taken(times)
        assert [each.stamp_ns for each in result] == [
            START_NS + round(time_s * 1e9) for time_s in times
        ], seed
        assert not any(each.notes or each.detail for each in result)


@pytest.mark.parametrize("rate_hz", [4.9, 5.0, 7.0, 10.0, 11.0])
def test_rates_that_the_model_holds_for_pass(rate_hz: float) -> None:
    times = np.arange(1, 101) / rate_hz
    assert len(taken(times)) == 100


@pytest.mark.parametrize("rate_hz", [12.5, 15.0, 20.0, 25.0, 30.0, 47.3, 50.0, 100.0, 200.0])
def test_faster_rates_become_10_hz(rate_hz: float) -> None:
    draw = np.random.default_rng(0)
    times = np.arange(1, round(20 * rate_hz) + 1) / rate_hz
    result = taken(times + draw.uniform(-0.2, 0.2, len(times)) / rate_hz)
    assert len(result) == pytest.approx(201, rel=0.04)
    stamps = np.array([each.stamp_ns for each in result[1:]])
    assert np.diff(stamps).max() <= 0.15e9 + 1.5e9 / rate_hz
    assert (np.diff(stamps) > 0).all()


@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 4.0, 300.0, 1000.0])
def test_other_rates_are_refused_by_name(rate_hz: float) -> None:
    result = taken(np.arange(1, 31) / rate_hz)
    late = result[-20:]
    assert {each.outcome for each in late} == {Outcome.OUT_OF_RANGE}
    assert f"rate: {rate_hz:g} Hz, but 5 to 200 Hz are needed" in late[-1].detail
    # what had passed before the rate was known is withdrawn
    PIPELINE().reset()
    answers = [PIPELINE().answer(each) for each in result]
    last = answers[-1].update.estimate
    assert (last.observations_used, last.observations_waiting) == (0, 0)


def test_a_rate_that_changes_is_followed_both_ways() -> None:
    ends = (20.0, 40.0, 60.0)
    times = np.concatenate(
        [np.arange(1, 201) * 0.1, 20.0 + np.arange(1, 1001) * 0.02, 40.0 + np.arange(1, 201) * 0.1]
    )
    stamps = np.array([(each.stamp_ns - START_NS) / 1e9 for each in taken(times)])
    counts = [int(((stamps > end - 20.0 + 1e-6) & (stamps <= end + 1e-6)).sum()) for end in ends]
    assert counts[0] == 200
    assert counts[1] == pytest.approx(200, abs=6)  # a few pass before the change is certain
    assert counts[2] == 200


def test_a_gap_ends_a_mean_and_begins_another() -> None:
    times = np.concatenate([np.arange(1, 104) * 0.02, 5.0 + np.arange(1, 101) * 0.02])
    result = taken(times)
    sizes = [each.notes[0].split()[2] for each in result[1:]]
    assert sizes == ["5"] * 20 + ["3"] + ["5"] * 20


def test_a_reading_that_cannot_be_used_enters_no_mean() -> None:
    times = np.arange(1, 101) * 0.02
    result = taken(times, lambda at: at != 52)
    assert result[11].notes == (
        "mean of 4 readings at 50 Hz",
        "1 left out: velocity is nan",
    )
    nothing = taken(times, lambda at: not 50 <= at < 55)[11]
    assert nothing.observation is not None
    assert math.isnan(nothing.observation.velocity)  # the estimator refuses it, and names why


def test_a_reading_that_noise_puts_out_of_range_belongs_to_the_mean() -> None:
    """Without it the mean of a small sinkage would be biased."""
    [model], averager = drive(10, 0.1), Averager(MARS, CoreConfig())
    result = []
    for step in range(1, 51):
        sinkage = np.full(3, -1e-4 if step % 5 == 0 else 4e-4)
        reading = dataclasses.replace(
            model, stamp_ns=step * 20_000_000, sinkage=sinkage, sinkage_sd=np.full(3, 3e-4)
        )
        result += averager.add(Conversion(reading.stamp_ns, reading))
    for each in result[1:]:
        assert each.observation is not None
        np.testing.assert_allclose(each.observation.sinkage, 3e-4)
        np.testing.assert_allclose(each.observation.sinkage_sd, 3e-4 / np.sqrt(5))


def test_a_turn_is_judged_by_the_mean_and_not_sorted_by_the_noise_of_readings() -> None:
    """Of readings about twice the limit, those below it must not make a straight drive of it."""
    [model], core = drive(10, 0.1), CoreConfig()
    rim = float(model.wheel_rate.max()) * MARS.wheel_radius
    limit = core.turn_limit * max(rim, model.velocity) / MARS.reach
    generator, averager, result = np.random.default_rng(5), Averager(MARS, core), []
    for step in range(1, 201):
        reading = dataclasses.replace(
            model,
            stamp_ns=step * 10_000_000,
            yaw_rate=float(2.0 * limit + limit * generator.standard_normal()),
            yaw_rate_sd=limit,
        )
        result += averager.add(Conversion(reading.stamp_ns, reading))
    means = [each.observation for each in result[1:] if each.observation]
    assert len(means) == 20
    refused = [screen(each, None, MARS, core).outcome is Outcome.NOT_PLANAR for each in means]
    # twice the noise of a mean of ten is 0.63 limits, so that a mean misses by 1.2 deviations
    assert sum(refused) > 12
    shares = [each.yaw_rate / limit for each in means]
    assert np.mean(shares) == pytest.approx(2.0, abs=0.25)  # 3.5 deviations of 200 readings


@pytest.mark.parametrize(("rate_hz", "first"), [(10.0, 0.1), (50.0, 0.1), (200.0, 0.1)])
def test_a_recording_is_read_without_what_is_withdrawn(rate_hz: float, first: float) -> None:
    [model] = drive(10, 0.1)
    readings = [
        Conversion(
            stamp_ns := round(at * 1e9 / rate_hz), dataclasses.replace(model, stamp_ns=stamp_ns)
        )
        for at in range(1, round(2 * rate_hz) + 1)
    ]
    result = list(averaged(readings, Averager(MARS, CoreConfig())))
    stamps = [each.stamp_ns / 1e9 for each in result]
    np.testing.assert_allclose(stamps, first + 0.1 * np.arange(20))


def test_the_counts_name_what_was_found() -> None:
    pipeline, counts, [model] = PIPELINE(), RateCounts(), drive(10, 0.1)
    pipeline.reset()
    for step in range(300):
        reading = dataclasses.replace(model, stamp_ns=START_NS + step * 20_000_000)
        pipeline.average(Conversion(reading.stamp_ns, reading))
        counts.add(pipeline.rate)
    assert counts.lines() == [
        "300 readings at 50 Hz, averaged to 10 Hz, with errors taken as independent"
    ]
    assert pipeline.rate.treatment is Treatment.AVERAGE
