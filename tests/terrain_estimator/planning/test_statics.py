# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The planner's tables say what the physics says, and no others are taken."""

import dataclasses
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.interpolate import RegularGridInterpolator
from scipy.stats import norm

from terrain_estimator.model.metadata import MODELS
from terrain_estimator.planning.belief import draw
from terrain_estimator.planning.finding import find_statics, statics_of
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.statics import (
    ENDING,
    Statics,
    StaticsError,
    interpolate,
    read_statics,
    write_statics,
)
from terrain_estimator.planning.table import TractionTable
from terramechanics.contact.stresses import quadrature, wheel_forces
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import level_pose, wheel_loads
from tests.rovers import BOGIE_IN_FRONT, FOUR_WHEELS
from tests.terrain_estimator.planning.support import METADATA, ROVER, SOIL, table

DRAWS = 200


def test_interpolation_is_that_of_scipy() -> None:
    random = np.random.default_rng(1)
    axes = tuple(np.sort(random.normal(size=n)) for n in (3, 5, 2))
    values = random.normal(size=(3, 5, 2, 4))
    low, high = (np.array([axis[end] for axis in axes]) for end in (0, -1))
    places = low + (high - low) * random.uniform(size=(DRAWS, 3))
    np.testing.assert_allclose(
        interpolate(axes, values, places), RegularGridInterpolator(axes, values)(places), atol=1e-12
    )
    beyond = np.array([low - 1.0, high + 1.0])
    np.testing.assert_allclose(
        interpolate(axes, values, beyond), [values[0, 0, 0], values[2, 4, 1]]
    )


def test_forces_of_a_wheel_are_those_of_the_stress_integrals() -> None:
    """To 0.5 % of the load, and of the load times the radius, from 2 % of the radius on."""
    random = np.random.default_rng(2)
    slips = table().statics.wheel_slips[0]
    slip = random.uniform(slips[0], slips[-1], DRAWS)
    sinkage = ROVER.wheel_radius * random.uniform(0.02, 0.9, DRAWS)
    exact = wheel_forces(
        torch.from_numpy(slip), torch.from_numpy(sinkage), SOIL.constants(), ROVER.wheel_radius,
        ROVER.wheel_width, quadrature(),
    )[:, [0, 2]].numpy()  # fmt: skip
    found = np.array([table().wheel(0, s, z) for s, z in zip(slip, sinkage, strict=True)])
    for ground in ((0.0, 0.3, 1.0), (500.0, 0.5, 1.0), (5000.0, 1.0, 1.0)):
        miss = (found - exact) @ np.array(ground)
        load = np.abs(exact[:, 0] * np.array(ground)).sum(-1)
        assert np.all(np.abs(miss[:, 0]) < 0.005 * load)
        assert np.all(np.abs(miss[:, 1]) < 0.005 * load * ROVER.wheel_radius)


@pytest.mark.parametrize(
    ("slip", "depth"), [(-0.7, 0.1), (0.96, 0.1), (0.1, 0.0), (0.1, -0.1), (0.1, 1.0)]
)
def test_outside_of_the_contact_law_there_are_no_forces(slip: float, depth: float) -> None:
    assert table().wheel(0, slip, depth * ROVER.wheel_radius) is None


@pytest.mark.parametrize("rover", [ROVER, FOUR_WHEELS, BOGIE_IN_FRONT], ids=lambda each: each.name)
def test_loads_are_those_of_the_balances(rover: Rover) -> None:
    random, axles = np.random.default_rng(3), rover.axles
    known = table() if rover is ROVER else TractionTable(rover, solve_statics(rover, [SOIL]))
    for _ in range(20):
        pitch, share = random.uniform(-0.5, 0.5), random.normal(0.0, 20.0)
        angle, torque = random.uniform(-0.4, 0.4, axles), random.normal(0.0, 5.0, axles)
        pose = replace(
            level_pose(rover, torch.zeros(1, dtype=torch.float64)),
            pitch=torch.tensor([pitch], dtype=torch.float64),
            contact_angle=torch.from_numpy(angle).unsqueeze(0),
        )
        traction = torch.full((1, axles), share, dtype=torch.float64)
        exact = wheel_loads(rover, pose, traction, torch.from_numpy(torque).unsqueeze(0))
        np.testing.assert_allclose(
            known.loads(pitch, angle, share, torque), exact[0], rtol=1e-10, atol=1e-9
        )


def test_samples_have_the_moments_of_the_estimate() -> None:
    mean = np.array([2000.0, 0.6])
    covariance = np.array([[200.0**2, -3.0], [-3.0, 0.05**2]])
    samples = draw(mean, covariance, (1.0,))
    scale = np.sqrt(np.diagonal(covariance))
    miss = (samples.strength[0] - mean) / scale
    np.testing.assert_allclose(miss.mean(0), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        np.cov(miss.T, bias=True), covariance / np.outer(scale, scale), atol=1e-12
    )
    assert abs(samples.spare[0].mean()) < 1e-12
    assert np.abs(np.corrcoef(miss.T, samples.spare[0])[2, :2]).max() < 1e-12
    # half of them within the quartiles of a normal variable, in each direction
    plain = draw(np.array([10.0, 10.0]), np.eye(2), (1.0,))
    every = np.column_stack([plain.strength[0] - 10.0, plain.spare[0]])
    np.testing.assert_allclose((np.abs(every) < norm.ppf(0.75)).mean(0), 0.5, atol=0.02)


def test_a_file_gives_back_what_was_written(tmp_path: Path) -> None:
    write_statics(tmp_path / f"mars_rover{ENDING}", table().statics, METADATA.sha256)
    found = find_statics(tmp_path / "mars_rover.pt", METADATA.sha256)
    for entry in dataclasses.fields(Statics):
        np.testing.assert_array_equal(
            getattr(found, entry.name), getattr(table().statics, entry.name)
        )


def test_the_installed_statics_are_those_of_the_installed_model() -> None:
    found, why = statics_of(MODELS / "mars_rover.pt", METADATA)
    assert not why
    assert len(found.pulls) == len(METADATA.soils)
    loose = [soil.name for soil in METADATA.soils].index(SOIL.name)
    for name in ("pulls", "wheel"):
        installed, solved = getattr(found, name)[loose], getattr(table().statics, name)[0]
        np.testing.assert_allclose(installed, solved, rtol=1e-9, atol=1e-9)


def test_without_a_file_the_statics_are_solved_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    mine = tmp_path / "mine.pt"
    found, why = statics_of(mine, dataclasses.replace(METADATA, soils=(SOIL,)))
    command = f"ros2 run terrain_estimator export_core {mine} FOLDER --build"
    assert why == f"mine.pt has no statics: {command} makes them"
    np.testing.assert_array_equal(found.wheel, table().statics.wheel)


def test_statics_of_another_model_are_refused(tmp_path: Path) -> None:
    path = tmp_path / f"mine{ENDING}"
    write_statics(path, table().statics, "a" * 64)
    with pytest.raises(StaticsError, match=r"mine\.statics\.npz: made from the model a{12}, this"):
        read_statics(path, METADATA.sha256)


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04 cut"])
def test_a_damaged_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / f"mine{ENDING}"
    path.write_bytes(content)
    with pytest.raises(StaticsError, match=r"mine\.statics\.npz: .*build them anew"):
        read_statics(path, METADATA.sha256)


def test_tables_that_are_not_finite_or_of_another_shape_are_refused(tmp_path: Path) -> None:
    statics = table().statics
    broken = statics.balances.copy()
    broken[0, 0, 0, 0] = math.nan
    with pytest.raises(StaticsError, match="balances is not finite"):
        replace(statics, balances=broken)
    with pytest.raises(StaticsError, match="wheel is not finite"):
        replace(statics, wheel=statics.wheel[:, :-1])
    path = tmp_path / f"mine{ENDING}"
    with path.open("wb") as file:
        np.savez(file, model=np.array(METADATA.sha256), pulls=statics.pulls)
    with pytest.raises(StaticsError, match="wheel_slips"):
        read_statics(path, METADATA.sha256)
