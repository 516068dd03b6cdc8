# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Solve the nonlinear statics of a rover once, for the planner's tables."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from terrain_estimator.observation import Floats
from terrain_estimator.planning.statics import (
    COHESIONS,
    ENTRY_ANGLES,
    SLIPS,
    STEEPNESSES,
    TAN_PHIS,
    TURNS,
    Statics,
)
from terramechanics.contact.laws import contact_law
from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP, in_range, quadrature
from terramechanics.terrain.soil import WONG_REECE, Soil
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.climbing import climb
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import balance_matrix, level_pose
from terramechanics.vehicle.turning import turn
from terramechanics.vehicle.wheel_places import WheelPlaces

_WHEEL_SLIPS = 63
"""Slips of the tables of one wheel; with so many, one lies at 0, where the law has a kink."""


def solve_statics(
    rover: Rover, soils: Sequence[Soil], places: WheelPlaces | None = None
) -> Statics:
    """Return the statics of a rover on some soils, which takes some seconds.

    With the ``places`` of its wheels those of turns, too, where it turns without steering and its
    soils have the law of Wong and Reece. Where balances do not determine its loads, these places
    are needed, and loads follow from the stiffness of chassis and ground. Raises ConfigError
    without them.
    """
    chassis: Chassis | None = None
    turns: Sequence[float] = TURNS
    if places is None:
        rover.check_planar()
    elif {soil.law for soil in soils} == {WONG_REECE} and not (
        places.steered and rover.is_determined
    ):
        turns = TURNS[:1] if places.steered else TURNS
        chassis = Chassis.of(rover, places.track_width, places.yaw_inertia)
    slips = np.stack([_slips(rover, soil) for soil in soils])
    wheels = [_wheel(rover, soil, each) for soil, each in zip(soils, slips, strict=True)]
    pulls = np.stack([_pulls(rover, soil, chassis, turns) for soil in soils])
    return Statics(pulls, slips, np.stack(wheels), _balances(rover))


def _pulls(rover: Rover, soil: Soil, chassis: Chassis | None, turns: Sequence[float]) -> Floats:
    axes = [
        torch.tensor(axis, dtype=torch.float64)
        for axis in (COHESIONS, TAN_PHIS, STEEPNESSES, SLIPS)
    ]
    cohesion, tan_phi, slope, slip = torch.cartesian_prod(*axes).unbind(1)
    constants, strength = soil.constants().expand(len(slip), 6), torch.stack([cohesion, tan_phi], 1)
    result = (
        climb(rover, constants, strength, slope, slip, law=soil.law)
        if chassis is None
        else turn(chassis, constants, strength, slope, slip, turns)
    )
    both = torch.stack([result.pull / (rover.weight * torch.cos(slope)), result.sinkage], -1)
    grid = both.view(-1, *(len(axis) for axis in axes), 2)
    values: Floats = grid.movedim(0, 3).contiguous().numpy()
    return values


def _slips(rover: Rover, soil: Soil) -> Floats:
    """Return the slips of the table of one wheel: those at which the law of the soil holds."""
    slip = torch.linspace(MIN_SLIP, MAX_SLIP, 1000, dtype=torch.float64)
    shallow = torch.full_like(slip, 0.1 * rover.wheel_radius)
    inside = slip[in_range(slip, shallow, soil.constants(), rover.wheel_radius)].numpy()
    low, high = float(inside[0]), float(inside[-1])
    before = round((_WHEEL_SLIPS - 1) * -low / (high - low))
    return np.append(
        np.linspace(low, 0.0, before, endpoint=False), np.linspace(0.0, high, _WHEEL_SLIPS - before)
    )


def _wheel(rover: Rover, soil: Soil, slips: Floats) -> Floats:
    sinkage = rover.wheel_radius * (1.0 - np.cos(ENTRY_ANGLES))
    slip, depth = (torch.from_numpy(x) for x in np.meshgrid(slips, sinkage, indexing="ij"))
    forces = contact_law(soil.law)(
        slip, depth, soil.constants(), rover.wheel_radius, rover.wheel_width, quadrature()
    )
    values: Floats = forces[..., [0, 2], :].numpy()
    return values


def _balances(rover: Rover) -> Floats:
    """Return the coefficients of the balances, from three contact angles."""
    angle = torch.tensor([0.0, 0.5 * math.pi, math.pi], dtype=torch.float64)
    pose = replace(
        level_pose(rover, torch.zeros_like(angle)),
        contact_angle=angle.unsqueeze(1).expand(-1, rover.axles),
    )
    ahead, above, back = balance_matrix(rover, pose).numpy()
    constant = 0.5 * (ahead + back)
    return np.stack([ahead - constant, above - constant, constant], -1)
