# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Whitened innovations of the blocks of simulated drives, honest ones and with a hidden effect."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from studies.batched import ClosedBlocks, run
from studies.foreign.residuals import kinds, residuals_of, whitened
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.learning.tasks import measure_tasks, random_ground
from terrain_estimator.model.packing import pack_measurement
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.vehicle.rover import Rover
from tests.hidden.cases import EACH, Plan, drive_ends, simulate_cases
from tests.hidden.matters import axle_means

Record = dict[str, NDArray[Any]]
_OWN = ("expected", "covariance")


def innovations(rover: Rover, soil: str, packed: Tensor, ends: Tensor) -> Record:
    """Return ``white`` [N, B, Q] of packed drives [N, T, P], NaN where no block was closed.

    The model is physics alone for the right soil, its constants within 5 %. With it come ``mean``
    and ``deviation`` [N, 2] of c [Pa] and tan phi after each drive.
    """
    model = physics_alone(rover, load_soil(soil), exact=False)
    drives, time, _ = packed.shape
    shape = (drives, time // model.block_size + 1, len(kinds(rover.axles)))
    white = torch.full(shape, torch.nan, dtype=torch.float64)

    def watch(closed: ClosedBlocks) -> None:
        states = ({name: state[name] for name in _OWN} for state in (closed.before, closed.after))
        found = torch.vmap(lambda rows, before, after: residuals_of(model, rows, before, after))(
            closed.rows, *states
        )
        white[closed.drives, closed.block] = whitened(found.innovation, found.spread)

    trace = run(model, packed, torch.tensor([time - 1]), ends, watch=watch)
    variance = trace.covariance[:, -1].diagonal(dim1=-2, dim2=-1)
    return {
        "white": white.numpy(),
        "mean": trace.mean[:, -1].numpy(),
        "deviation": variance.sqrt().numpy(),
    }


def honest(rover: str, soil: str, drives: int, seconds: float, seed: int) -> Record:
    """Return the record of drives over hills whose soil constants are up to 5 % wrong."""
    generator = torch.Generator().manual_seed(seed)
    car = load_rover(rover)
    ground = random_ground(load_soil(soil), drives, generator)
    drive = simulate(car, ground, "S1", seconds, generator, drives)
    packed = measure_tasks(drive, Noise(), generator).measured
    found = innovations(car, soil, packed, drive_ends(drive))
    return found | {"truth": ground.patches[0].strength.numpy()}


def hidden(effect: str, share: float, soil: str, cases: int, seed: int) -> Record:
    """Return the record of drives of the Mars-like rover with an effect; none where it is ''.

    ``share`` is of the size that matters.
    """
    parts = ((effect, share),) if effect else ()
    simulated = simulate_cases(Plan(parts, soil=soil), cases, seed)
    rover = simulated.drive.rover
    packed = pack_measurement(axle_means(simulated.measured, rover.axles))
    found = innovations(rover, soil, packed, drive_ends(simulated.drive))
    assert len(found["white"]) == cases * EACH
    return found | {"truth": simulated.drive.sample.strength[:, 0, 0].numpy()}


def closed(record: Record) -> int:
    """Return the number of blocks of a record."""
    return int(np.isfinite(record["white"][..., 0]).sum())
