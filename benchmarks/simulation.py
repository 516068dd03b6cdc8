# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Speed of the batched simulation on hills, beside plain NumPy loops of the same physics.

The simulation in three dimensions, with turns, stands beside the planar one.
"""

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator

import numpy as np
import torch

from benchmarks import numpy_rover
from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.numpy_rover import Floats, NumpyTrack
from terramechanics.description.layout import track_width_of
from terramechanics.effects import make_effect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.simulation import simulate, start
from terramechanics.simulation.spatial import BodySample, BodySimulation
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import STEEPEST, Hills
from terramechanics.terrain.surface import random_waves
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.steering import skid_command
from terramechanics.vehicle.wheel_places import box_inertia

BAR = 1e5  # rover-steps a second, on two cores
ROVERS = 2500  # of a batch: each step has a cost that they share
STEPS = 40
BY_ITSELF = 2  # rovers of the loops, which take so long
SPATIAL_ROVERS = 500
SPEED, YAW_RATE = 0.1, 0.08
"""[m/s], [rad/s] Of the rovers that turn: the yaw rate swings to both sides."""
Drive = Callable[..., float]
"""A drive of so many rovers with a seed; returns rover-steps in a second."""


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield one core against loops, all cores, an effect, single rovers, and three dimensions."""
    rovers = effort.count(ROVERS, least=50)
    loops = loops_speed(BY_ITSELF)
    name = "NumPy and SciPy loops over rovers, steps and wheels"
    one_core = warm(drive, rovers, 0)
    yield BenchmarkLine(
        "batched simulation, one core (second drive of a process)",
        one_core,
        "rover-steps/s",
        loops,
        least=True,
        reference=name,
        against=loops,
        note=f"{rovers} rovers a batch",
    )
    planar = on_every_core(drive, rovers)
    yield BenchmarkLine(
        "batched simulation, all cores (second drive of each process)",
        planar,
        "rover-steps/s",
        BAR,
        least=True,
        reference=name,
        against=loops,
        note=f"{rovers} rovers a batch",
    )
    pushed = on_every_core(drive, rovers, "bulldozing", 5e3)
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
        warm(drive, 1, 0),
        "rover-steps/s",
        None,
        least=True,
        reference=name,
        against=loops,
    )
    spatial = effort.count(SPATIAL_ROVERS, least=20)
    yield BenchmarkLine(
        "batched simulation in three dimensions, all cores (second drive of each process)",
        on_every_core(spatial_drive, spatial),
        "rover-steps/s",
        None,
        least=True,
        reference="the planar one, which has three wheels for six",
        against=planar,
        note=f"{spatial} rovers a core, six wheels, skid steering with turns on hills",
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


def turning(rovers: int, seed: int) -> Iterator[BodySample]:
    """Yield the steps of rovers that turn left and right on hills, with wheels that do not steer.

    Their bodies roll and pitch, and each of six wheels has forces along and across.
    """
    rover, soil = load_rover("mars_rover"), load_soil("loose_sand")
    generator = torch.Generator().manual_seed(seed)
    strength = Ground.random_strength(soil, rovers, generator).patches[0].strength
    track = track_width_of(rover)
    chassis = Chassis.of(rover, track, box_inertia(rover, track))
    hills = random_waves(rovers, STEEPEST, generator)
    begin = torch.rand(rovers, generator=generator, dtype=torch.float64)
    simulation = BodySimulation(
        chassis, soil.constants().expand(rovers, 6), strength, surface=hills
    )
    for step in range(STEPS):
        turn = YAW_RATE * torch.sin(2.0 * torch.pi * (begin + step / STEPS))
        twist = torch.stack([torch.full_like(turn, SPEED), torch.zeros_like(turn), turn], -1)
        yield simulation.step(*skid_command(chassis, twist))


def spatial_drive(rovers: int, seed: int) -> float:
    """Simulate one batch in three dimensions; return rover-steps in a second.

    Raises ArithmeticError where the balances of a rover have no solution.
    """
    torch.set_num_threads(1)
    begun_s = time.perf_counter()
    with torch.inference_mode():
        solved = torch.stack([sample.solved for sample in turning(rovers, seed)])
    spent_s = time.perf_counter() - begun_s
    if not solved.all():
        raise ArithmeticError(f"{int((~solved).sum())} of {solved.numel()} steps are not solved")
    return rovers * STEPS / spent_s


def warm(drive: Drive, rovers: int, seed: int, *effect: str | float) -> float:
    """Return ``drive`` of a process that has done one: its first compiles the integrals."""
    drive(rovers, seed, *effect)
    return drive(rovers, seed, *effect)


def on_every_core(drive: Drive, rovers: int, *effect: str | float) -> float:
    """Return the sum of :func:`warm` over one process for each core."""
    cores = os.cpu_count() or 1
    with multiprocessing.get_context("spawn").Pool(cores) as pool:
        given = [(drive, rovers, seed, *effect) for seed in range(cores)]
        return sum(pool.starmap(warm, given))


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
