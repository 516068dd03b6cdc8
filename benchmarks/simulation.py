# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Speed of the batched simulation on hills: rovers times steps in a second, by as many processes as there are cores."""

import multiprocessing
import os
import time

import torch

from terramechanics.effects import make_effect
from terramechanics.ground import Ground
from terramechanics.plant import Plant
from terramechanics.rover import load_rover
from terramechanics.simulation import TIME_STEP, simulate
from terramechanics.soil import load_soil

TARGET = 5e4  # rover-steps a second, on two cores
ROVERS = 1500
STEPS = 40


def drive(rovers: int, seed: int, effect: str = "", size: float = 0.0) -> tuple[float, float]:
    """Simulate one batch on hills; return rover-steps in a second of wall time and in a second of processor time."""
    torch.set_num_threads(1)
    generator = torch.Generator().manual_seed(seed)
    ground = Ground.random_strength(load_soil("loose_sand"), rovers, generator)
    plant = Plant([make_effect(effect, size)]) if effect else None
    wall, work = time.perf_counter(), time.process_time()
    simulate(load_rover("mars_rover"), ground, "S1", STEPS * TIME_STEP, generator, rovers, plant=plant)
    done = rovers * STEPS
    return done / (time.perf_counter() - wall), done / (time.process_time() - work)


def on_every_core(rovers: int = ROVERS, effect: str = "", size: float = 0.0) -> tuple[float, float]:
    """Sum over one process for each core of what :func:`drive` returns."""
    cores = os.cpu_count() or 1
    with multiprocessing.get_context("spawn").Pool(cores) as pool:
        results = pool.starmap(drive, [(rovers, seed, effect, size) for seed in range(cores)])
    wall, work = (sum(rates) for rates in zip(*results, strict=True))
    return wall, work


def report() -> bool:
    """Print what was measured; return whether the target is met."""
    wall, work = on_every_core()
    alone, _ = drive(1, 0)
    pushed, _ = on_every_core(effect="bulldozing", size=5e3)
    print(
        f"simulation        {wall:.0f} rover-steps a second on {os.cpu_count()} cores (target: {TARGET:g}), {work:.0f} in processor time;"
    )
    print(f"                  {pushed:.0f} with an effect; {alone:.0f} one rover at a time in one process")
    return wall >= TARGET
