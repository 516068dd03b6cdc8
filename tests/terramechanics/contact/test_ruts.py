# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Ruts that stay: what a wheel that follows finds, by distance, and what it does to a drive."""

import pytest
import torch

from rover_parameters.records import ConfigError
from terramechanics.contact.ruts import (
    REBOUND,
    KnownRuts,
    RutMemory,
    passed,
    ruts_by_distance,
    ruts_now,
)
from terramechanics.contact.scm import Rut, shear_left
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch

ROVER, LOOSE = load_rover("mars_rover"), load_soil("loose_sand")
SCM_SAND = LOOSE.with_values(law="scm", c1=0.02, c2=0.0)
R = ROVER.wheel_radius
AXLE_X = torch.tensor(ROVER.axle_x, dtype=torch.float64)
SLIP = torch.tensor([0.2, 0.1, 0.05], dtype=torch.float64)
SINKAGE = torch.tensor([0.014, 0.018, 0.017], dtype=torch.float64)
SPRING = torch.full((3,), REBOUND, dtype=torch.float64)


def test_the_front_wheel_finds_nothing_and_the_last_one_what_all_before_left() -> None:
    rut = ruts_now(SLIP, SINKAGE, R, SPRING)
    torch.testing.assert_close(rut.depth, torch.tensor([0.0, 0.014, 0.018], dtype=torch.float64))
    first = shear_left(SLIP[0], SINKAGE[0], R)
    second = shear_left(SLIP[1], 0.018 - 0.014 * (1.0 - SPRING[0]), R)
    torch.testing.assert_close(rut.shear, torch.stack([0.0 * first, first, first + second]))


def test_a_shallower_wheel_leaves_the_rut_as_deep_as_it_was() -> None:
    before = Rut(SINKAGE[1], SLIP[0] * 0.0)
    assert passed(before, SLIP[0], SINKAGE[0], R, SPRING[0]).depth == SINKAGE[1]


def test_what_a_wheel_finds_was_left_a_wheelbase_before() -> None:
    distance = torch.linspace(0.0, 4.0, 81, dtype=torch.float64)
    dug = torch.where(distance < 2.0, 0.010, 0.016).unsqueeze(1) + torch.tensor([0.0, 0.004, 0.006])
    slip = SLIP.expand(81, 3)
    rut = ruts_by_distance(distance, slip, dug, AXLE_X, R, distance)
    assert not rut.depth[:, 0].any()
    deep = rut.depth[:, 1:] > torch.tensor([0.013, 0.017], dtype=torch.float64)
    there = [int(column.nonzero()[0]) for column in deep.T]
    lag = float(AXLE_X[0] - AXLE_X[1])
    assert float(distance[there[0]]) == pytest.approx(2.0 + lag, abs=0.06)
    assert float(distance[there[1]]) == pytest.approx(2.0 + lag, abs=0.06)
    assert (rut.shear[-1].diff() > 0.0).all()


def test_the_memory_of_a_drive_is_the_look_up_by_distance() -> None:
    memory = RutMemory(R)
    steps = torch.arange(60, dtype=torch.float64) * 0.05
    slip = SLIP * (1.0 + 0.3 * torch.sin(steps)).unsqueeze(1)
    dug = SINKAGE * (1.0 + 0.1 * torch.cos(steps)).unsqueeze(1)
    expected = ruts_by_distance(steps, slip, dug, AXLE_X, R, steps)
    for k in range(60):
        places = (steps[k] + AXLE_X).unsqueeze(0)
        found = memory.at(places)
        if k == 0:
            found = ruts_now(slip[:1], dug[:1], R, SPRING.unsqueeze(0))
        elif k > 40:
            torch.testing.assert_close(found.depth[0], expected.depth[k], rtol=1e-9, atol=1e-12)
            torch.testing.assert_close(found.shear[0], expected.shear[k], rtol=1e-6, atol=1e-9)
        memory.remember(places, found, slip[k : k + 1], dug[k : k + 1], SPRING.unsqueeze(0))


def test_a_rover_that_stands_leaves_one_place() -> None:
    memory = RutMemory(R)
    for depth in (0.014, 0.02):
        none = Rut(torch.zeros(1, 3, dtype=torch.float64), torch.zeros(1, 3, dtype=torch.float64))
        places = AXLE_X.unsqueeze(0)
        memory.remember(places, none, SLIP.unsqueeze(0), torch.full((1, 3), depth), SPRING)
    assert float(memory.at(AXLE_X.unsqueeze(0)).depth[0, 1]) == pytest.approx(0.014)


def test_known_ruts_are_those_of_the_way_gone() -> None:
    gone = torch.tensor([[0.0, 1.0, 2.0]], dtype=torch.float64)
    depth = torch.tensor([[[0.0, 0.0, 0.0], [0.01, 0.02, 0.03]]], dtype=torch.float64)
    ruts = KnownRuts(gone, Rut(depth, 0.1 * depth), 2)
    start = torch.tensor([[5.0, 4.0], [9.0, 8.0]], dtype=torch.float64)
    ruts.at(start)
    found = ruts.at(start + torch.tensor([[0.5], [1.5]], dtype=torch.float64))
    torch.testing.assert_close(found.depth[:, 1], torch.tensor([0.015, 0.025]).double())


def test_wheels_behind_run_deeper_below_the_old_surface_and_shallower_below_the_rut() -> None:
    drive = simulate(
        ROVER, Ground.constant(SCM_SAND), "S3", 6.0, torch.Generator().manual_seed(1), 2
    )
    sinkage = drive.sample.sinkage[:, -1]
    assert (sinkage[:, 1] > sinkage[:, 0]).all()
    assert (sinkage[:, 1] < 1.5 * sinkage[:, 0]).all()


def test_laws_of_a_soil_are_checked() -> None:
    with pytest.raises(ConfigError, match="law: 'bekker' is no contact law: known are wong_reece"):
        LOOSE.with_values(law="bekker")
    with pytest.raises(ConfigError, match=r"c2: 0\.32 has no meaning under law scm"):
        LOOSE.with_values(law="scm")
    with pytest.raises(ValueError, match="one contact law, not scm, wong_reece"):
        Ground([Patch.of(LOOSE), Patch.of(SCM_SAND, start=1.0)])
