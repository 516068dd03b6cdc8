# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Speed of the batched simulation on hills, beside plain NumPy loops of the same physics."""

import multiprocessing
import os
import time
from collections.abc import Iterator

import numpy as np
import torch

from benchmarks import numpy_rover
from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.numpy_rover import Floats, NumpyTrack
from terramechanics.effects import make_effect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.simulation import simulate, start
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Hills
from terramechanics.vehicle.rover import Rover

BAR = 1e5  # rover-steps a second, on two cores
ROVERS = 1500
STEPS = 40
BY_ITSELF = 2  # rovers of the loops, which take so long


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield one core against loops, all cores, the same with an effect, one rover at a time."""
    rovers = effort.count(ROVERS, least=50)
    loops = loops_speed(BY_ITSELF)
    name = "NumPy and SciPy loops over rovers, steps and wheels"
    one_core = warm_drive(rovers, 0)
    yield BenchmarkLine(
        "batched simulation, one core (second drive of a process)",
        one_core,
        "rover-steps/s",
        loops,
        least=True,
        reference=name,
        against=loops,
    )
    yield BenchmarkLine(
        "batched simulation, all cores (second drive of each process)",
        on_every_core(rovers),
        "rover-steps/s",
        BAR,
        least=True,
        reference=name,
        against=loops,
    )
    pushed = on_every_core(rovers, "bulldozing", 5e3)
    yield BenchmarkLine(
        "the same with an effect",
        pushed,
        "rover-steps/s",
        None,
        least=True,
        reference=name,
        against=loops,
    )
    yield BenchmarkLine(
        "one rover at a time",
        warm_drive(1, 0),
        "rover-steps/s",
        None,
        least=True,
        reference=name,
        against=loops,
    )


def drive(rovers: int, seed: int, effect: str = "", size: float = 0.0) -> float:
    """Simulate one batch on hills; return rover-steps in a second."""
    torch.set_num_threads(1)
    generator = torch.Generator().manual_seed(seed)
    ground = Ground.random_strength(load_soil("loose_sand"), rovers, generator)
    plant = Plant([make_effect(effect, size)]) if effect else None
    begun_s = time.perf_counter()
    simulate(
        load_rover("mars_rover"), ground, "S1", STEPS * TIME_STEP, generator, rovers, plant=plant
    )
    return rovers * STEPS / (time.perf_counter() - begun_s)


def warm_drive(rovers: int, seed: int, effect: str = "", size: float = 0.0) -> float:
    """Return :func:`drive` of a process that has done one: its first compiles the integrals."""
    drive(rovers, seed, effect, size)
    return drive(rovers, seed, effect, size)


def on_every_core(rovers: int, effect: str = "", size: float = 0.0) -> float:
    """Return the sum of :func:`warm_drive` over one process for each core."""
    cores = os.cpu_count() or 1
    with multiprocessing.get_context("spawn").Pool(cores) as pool:
        given = [(rovers, seed, effect, size) for seed in range(cores)]
        return sum(pool.starmap(warm_drive, given))


def loops_speed(rovers: int) -> float:
    """Return the rover-steps in a second of the loops."""
    drawn = same_drives(rovers, STEPS, 0)
    begun_s = time.perf_counter()
    numpy_rover.fleet(*drawn, TIME_STEP)
    return rovers * STEPS / (time.perf_counter() - begun_s)


def same_drives(
    rovers: int, steps: int, seed: int
) -> tuple[Rover, list[NumpyTrack], Floats, Floats]:
    """Draw rover, tracks, start velocities [rovers] and wheel rates [rovers, 1 + steps, 3]."""
    generator = torch.Generator().manual_seed(seed)
    rover, soil = load_rover("mars_rover"), load_soil("loose_sand")
    ground = Ground.random_strength(soil, rovers, generator)
    simulation, schedule = start(rover, ground, "S1", generator, rovers)
    hills = simulation.profile
    if not isinstance(hills, Hills):
        raise TypeError(f"S1 is driven on {type(hills).__name__}, the loops know hills")
    commands = np.stack(
        [schedule.command(step * TIME_STEP).numpy() for step in range(steps + 1)], axis=1
    )
    waves = (
        hills.amplitude.numpy(),
        hills.wavenumber.numpy(),
        hills.phase.numpy(),
        ground.patches[0].strength.numpy(),
    )
    tracks = [
        NumpyTrack(float(mean), amplitude, wavenumber, phase, soil.constants().numpy(), strength)
        for mean, amplitude, wavenumber, phase, strength in zip(
            hills.mean[:, 0], *waves, strict=True
        )
    ]
    return rover, tracks, schedule.start_velocity.numpy(), commands
