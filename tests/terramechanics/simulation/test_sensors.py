# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor noise: its size, its independence, and the honesty of the published standard deviations.

Spreads of n independent samples are compared with 4.5 / sqrt(2 n) of relative tolerance: a right
model fails one such comparison in 150 000.
"""

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from rover_parameters.records import ConfigError, build
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import Measurement, Sample
from terramechanics.simulation.sensors import (
    Noise,
    acceleration_bias,
    measure,
    measure_drive,
    per_wheel,
)
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground
from terramechanics.vehicle.rover import Rover

SAMPLES = 40_000
DEGREE = math.pi / 180.0


def truth(**values: float) -> Sample:
    """Repeat a true sample many times, [SAMPLES] and [SAMPLES, 3]."""
    scalars = {"velocity": 0.15, "acceleration": 0.01, "pitch": 0.04}
    axles = {"slip": 0.2, "sinkage": 0.018, "contact_angle": 0.03, "wheel_rate": 1.2, "torque": 4.0}
    filled: dict[str, Tensor] = {}
    for item in dataclasses.fields(Sample):
        shape = (SAMPLES, 3) if item.name in axles else (SAMPLES,)
        filled[item.name] = torch.full(
            shape, {**scalars, **axles, **values}.get(item.name, 0.0), dtype=torch.float64
        )
    return Sample(**filled)


def measured(rover: Rover, sample: Sample, factor: float = 1.0, seed: int = 1) -> Measurement:
    bias = torch.zeros(1, dtype=torch.float64)
    return measure(rover, sample, Noise(factor=factor), bias, torch.Generator().manual_seed(seed))


EXPECTED = [
    ("slip", 0.2, math.hypot(0.05 * 0.2, 0.005)),
    ("slip", 0.0, 0.005),
    ("sinkage", 0.018, math.hypot(0.05 * 0.018, 0.0003)),
    ("contact_angle", 0.03, 0.3 * DEGREE),
    ("torque", 4.0, math.hypot(0.03 * 4.0, 0.01 * 0.3 * 0.13 * 185.0 * 3.72 / 6.0)),
    ("velocity", 0.15, 0.01),
    ("pitch", 0.04, 0.3 * DEGREE),
]


@pytest.mark.parametrize(("name", "value", "spread"), EXPECTED)
def test_the_noise_has_its_size_and_no_mean(name: str, value: float, spread: float) -> None:
    rover = load_rover("mars_rover")
    errors = (getattr(measured(rover, truth(**{name: value})), name) - value).flatten()
    assert float(errors.std()) == pytest.approx(spread, rel=4.5 / math.sqrt(2.0 * errors.numel()))
    assert abs(float(errors.mean())) < 4.5 * spread / math.sqrt(errors.numel())
    kurtosis = float((errors**4).mean() / (errors**2).mean() ** 2)
    assert kurtosis == pytest.approx(3.0, abs=4.5 * math.sqrt(24.0 / errors.numel()))


def test_the_papers_rover_measures_its_small_sinkage_finer() -> None:
    rover = load_rover("paper_rover")
    errors = measured(rover, truth(sinkage=1.4e-4)).sinkage - 1.4e-4
    assert float(errors.std()) == pytest.approx(math.hypot(0.05 * 1.4e-4, 5e-5), rel=0.02)


def test_errors_of_different_wheels_and_samples_are_independent() -> None:
    rover = load_rover("mars_rover")
    result = measured(rover, truth())
    columns = [result.slip, result.sinkage, result.contact_angle, result.torque]
    singles = [result.velocity, result.pitch, result.acceleration]
    everything = torch.cat([*columns, *(single.unsqueeze(-1) for single in singles)], dim=-1)
    correlation = torch.corrcoef(everything.T) - torch.eye(15, dtype=torch.float64)
    assert float(correlation.abs().max()) < 5.0 / math.sqrt(SAMPLES)
    lagged = torch.corrcoef(torch.stack([result.slip[1:, 0], result.slip[:-1, 0]]))[0, 1]
    assert abs(float(lagged)) < 5.0 / math.sqrt(SAMPLES)


def test_published_deviations_follow_from_what_is_measured_not_from_the_truth() -> None:
    rover = load_rover("mars_rover")
    result = measured(rover, truth())
    torch.testing.assert_close(result.slip_sd, torch.sqrt((0.05 * result.slip) ** 2 + 0.005**2))
    torch.testing.assert_close(
        result.sinkage_sd, torch.sqrt((0.05 * result.sinkage) ** 2 + 0.0003**2)
    )
    floor = 0.01 * 0.3 * 0.13 * 185.0 * 3.72 / 6.0
    torch.testing.assert_close(result.torque_sd, torch.sqrt((0.03 * result.torque) ** 2 + floor**2))
    assert float(result.velocity_sd.min()) == float(result.velocity_sd.max()) == 0.01


def test_the_accelerometer_reads_specific_force_with_one_bias_a_drive() -> None:
    rover = load_rover("mars_rover")
    generator = torch.Generator().manual_seed(2)
    drive = simulate(rover, Ground.constant(load_soil("loose_sand")), "S3", 3.0, generator, 200)
    result = measure_drive(rover, drive.sample, Noise(), generator)
    errors = result.acceleration - drive.sample.specific_force(rover.gravity)
    offsets = errors.mean(-1)
    within = errors - offsets.unsqueeze(-1)
    assert float(within.std()) == pytest.approx(0.02, rel=0.05)
    # 200 biases of 0.02, and the mean of 30 noises in each.
    expected = math.sqrt(0.02**2 + 0.02**2 / 30.0)
    assert float(offsets.std()) == pytest.approx(expected, rel=4.5 / math.sqrt(400.0))
    assert float(result.acceleration_sd[0, 0]) == pytest.approx(0.02 * math.sqrt(2.0))


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Noise)])
def test_no_part_of_the_noise_may_be_negative(name: str) -> None:
    assert getattr(build(Noise, {name: 0.0}, "noise"), name) == 0.0
    with pytest.raises(ConfigError, match=f"noise: {name}: -1e-06 is outside its range"):
        build(Noise, {name: -1e-6}, "noise")


def test_hardly_correlated_noise_is_the_independent_one() -> None:
    rover, sample = load_rover("mars_rover"), truth()
    drive = Sample(
        **{
            item.name: getattr(sample, item.name)[:40].unsqueeze(0)
            for item in dataclasses.fields(Sample)
        }
    )
    alone, together = (
        measure_drive(rover, drive, Noise(), torch.Generator().manual_seed(5), correlation)
        for correlation in (0.0, 1e-9)
    )
    torch.testing.assert_close(together.slip, alone.slip, atol=1e-9, rtol=0.0)
    torch.testing.assert_close(together.velocity, alone.velocity, atol=1e-9, rtol=0.0)


def test_without_noise_the_truth_is_measured_and_deviations_stay_positive() -> None:
    rover = load_rover("mars_rover")
    sample = truth()
    result = measured(rover, sample, factor=0.0)
    assert torch.equal(result.slip, sample.slip)
    assert torch.equal(result.velocity, sample.velocity)
    assert float(acceleration_bias(Noise(factor=0.0), 3, torch.Generator()).abs().max()) == 0.0
    for name in (
        "slip_sd",
        "sinkage_sd",
        "contact_angle_sd",
        "torque_sd",
        "velocity_sd",
        "pitch_sd",
        "acceleration_sd",
    ):
        assert float(getattr(result, name).min()) > 0.0


def test_half_the_noise_is_half_the_error_and_half_the_deviation() -> None:
    rover = load_rover("mars_rover")
    sample = truth()
    full, half = measured(rover, sample), measured(rover, sample, factor=0.5)
    torch.testing.assert_close(2.0 * (half.slip - sample.slip), full.slip - sample.slip)
    assert float(half.velocity_sd[0]) == 0.005


def test_wheel_rates_are_exact_and_an_undefined_slip_stays_undefined() -> None:
    rover = load_rover("mars_rover")
    sample = truth(slip=math.nan)
    result = measured(rover, sample)
    assert torch.equal(result.wheel_rate, sample.wheel_rate)
    assert bool(result.slip.isnan().all())


def test_every_wheel_of_an_axle_has_the_axles_values_and_its_own_noise() -> None:
    rover = load_rover("mars_rover")
    axles = truth()
    axles.slip[:, 0], axles.slip[:, 2] = 0.1, 0.4
    constants, strength = Ground.constant(load_soil("loose_sand")).at(
        torch.zeros(SAMPLES, 3, dtype=torch.float64)
    )
    others = dict.fromkeys(("contact", "normal", "traction", "ground_torque", "valid"), axles.slip)
    wheels = per_wheel(
        rover, dataclasses.replace(axles, constants=constants, strength=strength, **others)
    )
    assert wheels.slip[0].tolist() == [0.1, 0.1, 0.2, 0.2, 0.4, 0.4]
    assert wheels.constants.shape == (SAMPLES, 6, 6)
    result = measured(rover, wheels)
    pair = torch.corrcoef(result.slip[:, :2].T)[0, 1]
    assert abs(float(pair)) < 5.0 / math.sqrt(SAMPLES)
