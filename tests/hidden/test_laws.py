# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden laws differ from the library's by more than the noise of a set of drives."""

import itertools
from functools import cache

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.library import LibraryEffect
from terramechanics.effects import make_effect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import Effect, Plant
from terramechanics.simulation.sample import Drive
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from tests.hidden.cases import DRIVES
from tests.hidden.equivalent import equivalent_size
from tests.hidden.generators import GENERATORS, Draw

MARS = load_rover("mars_rover")
BATCH, STEPS = 3, 50
SET_OF_DRIVES = DRIVES * 600
"""Samples of five one-minute drives."""
ABOVE_NOISE = 25.0
"""Squared differences in sensor deviations: five times those of noise in the best contrast."""
SIGNALS = ("velocity", "pitch", "slip", "sinkage", "torque")
OTHER_LAWS = (
    "bulldozing",
    "grousers",
    "slip_sinkage",
    "multipass",
    "odometry_scale",
    "rate_dependence",
)


def drive(effect: Effect) -> Drive:
    generator = torch.Generator().manual_seed(31)
    strength = torch.tensor([[2500.0, 0.6], [1500.0, 0.7], [3500.0, 0.5]], dtype=torch.float64)
    ground = Ground([Patch(load_soil("regolith").constants(), strength)])
    return simulate(MARS, ground, "S1", STEPS / 10.0, generator, BATCH, plant=Plant([effect]))


@cache
def leftover(name: str) -> float:
    """Return the residual of the hidden law over five minutes.

    It is the least of named laws of three sizes, with further values up to two deviations each way.
    """
    sizes = torch.full((BATCH,), GENERATORS[name].matters, dtype=torch.float64)
    effect = GENERATORS[name].make(Draw(sizes, torch.full((BATCH,), 2), torch.zeros(BATCH)))
    hidden = drive(effect)
    size = equivalent_size(name, effect, hidden, range(BATCH))
    measured = measure_drive(MARS, hidden.seen, Noise(), torch.Generator().manual_seed(1))

    def distance(named: Drive) -> float:
        parts = [
            (
                (getattr(named.seen, signal) - getattr(hidden.seen, signal))
                / torch.as_tensor(getattr(measured, f"{signal}_sd"))
            ).square()
            for signal in SIGNALS
        ]
        return float(sum(part.sum() for part in parts)) / (BATCH * STEPS) * SET_OF_DRIVES

    named = LibraryEffect(name)
    rest = [[step * each.sd for step in (-2, -1, 0, 1, 2)] for each in named.law.extra]
    return min(
        distance(drive(named.acting([named.law.value_of(size * factor), *further])))
        for factor in (0.85, 1.0, 1.15)
        for further in itertools.product(*rest)
    )


def test_at_least_five_hidden_laws_differ_from_the_named_ones_by_more_than_noise() -> None:
    found = {name: leftover(name) for name in OTHER_LAWS}
    assert sum(value > ABOVE_NOISE for value in found.values()) >= 5, found


def test_the_measure_is_zero_for_a_law_that_is_the_named_one() -> None:
    sizes: Tensor = torch.full((BATCH,), 10.0, dtype=torch.float64)
    one, other = (drive(make_effect("payload", size)).seen for size in (sizes, 10.0))
    assert (
        max(
            float((getattr(one, signal) - getattr(other, signal)).abs().max()) for signal in SIGNALS
        )
        < 1e-9
    )
