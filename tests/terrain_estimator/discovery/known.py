# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Two short drives whose missing effect is known, for the tests of the discovery."""

from functools import cache

import torch

from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.runs import RecordedRun, cut
from terrain_estimator.learning.tasks import measure_tasks
from terrain_estimator.model.row_names import row_names
from terramechanics.effects import make_effect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.vehicle.rover import Rover

MARS, LOOSE = load_rover("mars_rover"), load_soil("loose_sand")
SIZES = {
    "drive_drag": 0.5,
    "slope_bias": 0.01,
    "multipass": 0.3,
    "bulldozing": 2e4,
    "coulomb_drag": 0.1,
}


@cache
def drives(name: str, rover: Rover = MARS) -> tuple[RecordedRun, ...]:
    """Return two drives of 25 s with the soil constants as in the file.

    ``name`` is that of an effect, of several with ``+`` between them, or empty.
    """
    generator = torch.Generator().manual_seed(41)
    strength = torch.tensor([[2500.0, 0.6], [1500.0, 0.7]], dtype=torch.float64)
    effects = [make_effect(each, SIZES[each]) for each in name.split("+") if each]
    plant = Plant(effects) if effects else None
    drive = simulate(
        rover, Ground([Patch(LOOSE.constants(), strength)]), "S1", 25.0, generator, 2, plant=plant
    )
    packed = measure_tasks(drive, Noise(), generator).measured
    time = torch.arange(packed.shape[1], dtype=torch.float64) * 0.1
    return tuple(
        RecordedRun(f"run {k}", packed[k], drive.seen.wheel_rate[k], time) for k in range(2)
    )


@cache
def study(name: str, *, bogie_angle: bool = True, rover: Rover = MARS) -> Study:
    nominal, rows = nominal_of(rover, LOOSE), row_names(rover.axles)
    mask = torch.tensor([float(bogie_angle or "moment" not in row) for row in rows]).double()
    with torch.inference_mode():
        return Study(nominal, [cut(run, nominal.contact) for run in drives(name, rover)], mask)
