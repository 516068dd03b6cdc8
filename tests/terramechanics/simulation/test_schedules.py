# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The named drives are what their definitions say."""

import math

import pytest
import torch
from torch import Tensor

from terramechanics.contact.sinkage import WheelGround, free_rolling
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.schedules import (
    Command,
    Schedule,
    SineRates,
    TorqueBands,
    make_profile,
    make_schedule,
)
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Flat, Hills
from terramechanics.vehicle.rover import Rover

BATCH = 200
ROVER = load_rover("mars_rover")
GROUND = Ground.constant(load_soil("loose_sand"))


def schedule(name: str, rover: Rover = ROVER) -> Schedule:
    return make_schedule(name, rover, GROUND, BATCH, torch.Generator().manual_seed(1))


def commands(drive: Schedule, seconds: float = 40.0) -> Tensor:
    """[time, batch, axles]."""
    return torch.stack([drive.command(0.1 * (step + 1)) for step in range(round(10 * seconds))])


def test_s1_is_two_sines_of_every_axle_about_a_cruise_speed() -> None:
    drive = schedule("S1")
    assert isinstance(drive, SineRates)
    assert drive.kind is Command.RATE
    v0, f, p = drive.start_velocity, drive.frequency, drive.phase
    for low, high, values in ((0.10, 0.25, v0), (0.03, 0.12, f), (0.0, 2.0 * math.pi, p)):
        assert low <= float(values.min()) < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < float(values.max()) <= high
    time = 12.3
    wave = 0.6 * torch.sin(2 * math.pi * f[0] * time + p[0]) + 0.4 * torch.sin(
        2 * math.pi * f[1] * time + p[1]
    )
    expected = (v0 / 0.13).unsqueeze(-1) * (1.0 + 0.25 * wave)
    torch.testing.assert_close(drive.command(time), expected)
    assert not torch.equal(expected[:, 0], expected[:, 1])


def test_phases_have_nothing_in_common_with_frequencies() -> None:
    """Of 2 * 200 * 3 pairs: below 4 / sqrt(1200)."""
    drive = schedule("S1")
    assert isinstance(drive, SineRates)
    pair = torch.stack([drive.frequency.flatten(), drive.phase.flatten()])
    assert abs(float(torch.corrcoef(pair)[0, 1])) < 4.0 / math.sqrt(1200)


def test_the_papers_rover_drives_faster() -> None:
    speeds = schedule("S1", load_rover("paper_rover")).start_velocity
    assert 0.2 <= float(speeds.min()) < 0.22
    assert 0.58 < float(speeds.max()) <= 0.6


def test_s2_redraws_torques_from_one_band_for_20_s_and_then_from_one_of_half() -> None:
    drive = schedule("S2")
    assert isinstance(drive, TorqueBands)
    assert drive.kind is Command.TORQUE
    torques = commands(drive) / drive.high[:, None]
    first, second = torques[:200], torques[200:]
    low = float((drive.low / drive.high).min())
    for band, scale in ((first, 1.0), (second, 0.5)):
        assert float(band.max()) <= scale
        assert float(band.min()) >= low * scale
        assert float(band.max()) > 0.99 * scale
    # Torques of neighbouring steps have nothing in common: a correlation of 200 * 200 * 3 pairs
    # stays within 4 / sqrt(120000).
    centred = first - first.mean(0)
    correlation = (centred[1:] * centred[:-1]).sum() / (centred**2).sum()
    assert abs(float(correlation)) < 4.0 / math.sqrt(120000) + 1.0 / 200


def test_the_first_band_of_s2_pulls_and_the_second_does_not() -> None:
    drive = schedule("S2")
    assert isinstance(drive, TorqueBands)
    soil = load_soil("loose_sand")
    wheel = WheelGround.of(ROVER, soil.constants(), soil.strength(), 12)
    free = float(
        wheel.forces(*free_rolling(wheel, torch.tensor([ROVER.weight / 6.0], dtype=torch.float64)))[
            0, 2
        ]
    )
    assert float(drive.low.min()) > free
    assert float(drive.high.max()) / 2.0 < free


def test_s3_is_one_constant_rate_for_all_wheels() -> None:
    rates = commands(schedule("S3"), 5.0)
    assert torch.equal(rates, rates[:1, :, :1].expand_as(rates))


def test_s4_is_s1_with_square_waves_of_half_the_rate() -> None:
    smooth, square = schedule("S1"), schedule("S4")
    ratio = commands(square, 8.0) / commands(smooth, 8.0)
    torch.testing.assert_close(ratio.amax((1, 2)), ratio.amin((1, 2)))
    wave = ratio[:, 0, 0].round(decimals=9).tolist()
    assert wave == [1.5 if step // 10 % 2 == 0 else 0.5 for step in range(80)]


def test_every_schedule_has_its_own_ground() -> None:
    kinds = {
        name: type(make_profile("", name, ROVER, GROUND, 3, torch.Generator().manual_seed(1)))
        for name in ("S1", "S2", "S3", "S4", "cmd_vel")
    }
    assert kinds == {"S1": Hills, "S2": Flat, "S3": Flat, "S4": Hills, "cmd_vel": Flat}
    assert isinstance(
        make_profile("hills", "S3", ROVER, GROUND, 3, torch.Generator().manual_seed(1)), Hills
    )


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(
        ValueError, match="unknown schedule 'S5'; known schedules are S1, S2, S3, S4"
    ):
        schedule("S5")
    with pytest.raises(ValueError, match="unknown profile 'moon'; known profiles are flat, hills"):
        make_profile("moon", "S1", ROVER, GROUND, 1, torch.Generator())
