# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The ground of a drive, and the limits of soils and rovers."""

import dataclasses
import math
from collections.abc import Callable

import pytest
import torch

from rover_parameters.records import ConfigError
from terramechanics.presets import load_rover, load_soil
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.vehicle.rover import Rover

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")


def test_the_ground_changes_over_its_transition_and_sharply_without_one() -> None:
    soft, hard = load_soil("loose_sand"), load_soil("compact_sand")
    ground = Ground([Patch.of(soft), Patch.of(hard, 2.0, 4.0), Patch.of(soft, 7.0)])
    places = torch.tensor([[-5.0, 2.0, 3.0], [5.0, 6.0, 6.99], [7.0, 7.01, 90.0]]).double()
    constants, strength = ground.at(places)
    share = torch.tensor([[0.0, 0.0, 0.25], [0.75, 1.0, 1.0], [0.0, 0.0, 0.0]]).double()
    for found, one, other in (
        (constants, soft.constants(), hard.constants()),
        (strength, soft.strength(), hard.strength()),
    ):
        torch.testing.assert_close(found, one + share[..., None] * (other - one))
    assert [ground.patch_at(x) for x in (-1.0, 0.0, 1.9, 2.0, 6.9, 7.0)] == [0, 0, 0, 1, 1, 2]


def test_a_patch_begins_at_the_start_of_the_track_and_sharply_unless_it_is_placed() -> None:
    soft, hard = load_soil("loose_sand"), load_soil("compact_sand")
    ground = Ground([Patch(soft.constants(), soft.strength()), Patch.of(hard, 0.5)])
    assert [ground.patch_at(x) for x in (0.0, 0.49, 0.5)] == [0, 0, 1]


@pytest.mark.parametrize(
    "patches",
    [
        list,
        lambda: [Patch.of(SOIL), Patch.of(SOIL, 2.0, 4.0), Patch.of(SOIL, 5.9)],
        lambda: [Patch.of(SOIL, 1.0), Patch.of(SOIL, 0.5)],
        lambda: [Patch.of(SOIL), Patch.of(SOIL, 1.0, -0.1)],
    ],
)
def test_patches_that_overlap_are_refused(patches: Callable[[], list[Patch]]) -> None:
    with pytest.raises(ValueError, match="patch"):
        Ground(patches())


def test_random_strengths_are_uniform_in_cohesion_and_in_the_friction_angle() -> None:
    """5000 draws: the ends within 1 % of the range, the mean within 4 standard errors."""
    generator = torch.Generator().manual_seed(4)
    ground = Ground.random_strength(SOIL, 5000, generator)
    cohesion, tan_phi = ground.patches[0].strength.unbind(-1)
    for values, low, high in (
        (cohesion, 500.0, 5000.0),
        (torch.atan(tan_phi), math.radians(15.0), math.radians(45.0)),
    ):
        width = high - low
        assert low <= float(values.min()) < low + 0.01 * width
        assert high - 0.01 * width < float(values.max()) <= high
        error = width / math.sqrt(12.0 * 5000.0)
        assert float(values.mean()) == pytest.approx((low + high) / 2.0, abs=4.0 * error)
    narrow = Ground.random_strength(SOIL, 10, generator, cohesion=(1.0, 2.0))
    assert float(narrow.patches[0].strength[:, 0].max()) <= 2.0


LIMITS = {
    "n": (0.0, 3.0, False),
    "k_phi": (0.0, math.inf, False),
    "shear_modulus": (0.0, 1.0, False),
    "c1": (0.0, 1.0, False),
    "c2": (-1.0, 1.0, True),
    "cohesion": (0.0, math.inf, True),
    "tan_phi": (0.0, 2.0, True),
}
"""Lowest and highest value of each constant, and whether the lowest itself is taken."""


@pytest.mark.parametrize("name", LIMITS)
def test_a_soil_constant_is_refused_outside_of_its_physical_range(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    low, high, closed = LIMITS[name]
    folder = tmp_path_factory.mktemp("soils")

    def taken(value: float) -> bool:
        values = {key: getattr(SOIL, key) for key in (*LIMITS, "k_c")} | {name: value}
        path = folder / "soil.yaml"
        lines = [f"{key}: {number!r}" for key, number in values.items()]
        path.write_text("\n".join(["name: soil", *lines]), encoding="utf-8")
        try:
            load_soil(path)
        except ConfigError as error:
            assert name in str(error)  # noqa: PT017 # the message names what is wrong
            return False
        return True

    assert taken(low) == closed
    assert taken(low + 1e-6)
    assert not taken(low - 1e-6)
    if math.isfinite(high):
        assert taken(high)
        assert not taken(high + 1e-6)


def changed(**values: object) -> Rover:
    return dataclasses.replace(ROVER, **values)  # type: ignore[arg-type]


def test_a_rover_whose_parts_are_out_of_order_is_refused() -> None:
    front, middle, rear = ROVER.axle_x
    for axle_x in (
        (middle, front, rear),
        (front, rear, middle),
        (front, front, rear),
        (front, rear, rear),
    ):
        with pytest.raises(ConfigError, match="axle_x"):
            changed(axle_x=axle_x)
    for pivot in (middle, rear, middle + 0.1, rear - 0.1):
        with pytest.raises(ConfigError, match="bogie_pivot_x"):
            changed(bogie_pivot_x=pivot)
    with pytest.raises(ConfigError, match="cruise_speed"):
        changed(cruise_speed=(0.2, 0.1))
    assert changed(cruise_speed=(0.2, 0.2)).cruise_speed == (0.2, 0.2)
    with pytest.raises(ConfigError, match="same number"):
        changed(wheels=ROVER.wheels[:-1])
    with pytest.raises(ConfigError, match="all different"):
        changed(wheels=(*ROVER.wheels[:-1], ROVER.wheels[0]))
    assert changed(wheels=ROVER.wheels[::2]).wheels_per_axle == 1
