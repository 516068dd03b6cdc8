# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives with turns and a hidden effect, by models by wheel with and without that effect.

A drive is hidden by the law of tests/hidden where it has one of the name, else by the library's
own. Speed and yaw rate vary, slopes go to 6 degrees, each soil constant is wrong by up to 5 %.
"""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from studies.by_wheel.drives import Ended, ended, model_by_wheel
from studies.by_wheel.motions import hidden_effect
from terrain_estimator.learning.adding import Sized, add_effects
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.effects import not_estimated
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.observation import Observation
from terramechanics.effects import EFFECTS
from terramechanics.simulation.plant import Effect
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import chassis_places, wheel_order
from tests.hidden.generators import GENERATORS, SCALES, Draw, sizes_of
from tests.hidden.sensing import WEAR, Sensed
from tests.turning_hidden import Turning, driven

SEED = 96_000_000
"""Of the drives; 100 more for the second rover, and the number of the effect in the registry."""
DRIVES, SECONDS = 12, 60.0
NAMES = tuple(name for name in EFFECTS if name not in not_estimated(by_wheel=True))
HEAD = (
    "effect",
    "law hidden",
    "with it: error",
    "hold",
    "IDENTIFIED, wrong",
    "without: error",
    "hold",
    "IDENTIFIED, wrong",
)


def hidden(
    name: str, rover: Rover, drives: int, generator: torch.Generator, *, own: bool = False
) -> tuple[Effect, str]:
    """Return an effect of the size that matters on the rover, one each drive, and its law.

    With ``own`` it is the library's, at one size. UnevenWear has the wear of three axles.
    """
    known = None if own else GENERATORS.get(name)
    if known is None or (name == "odometry_scale" and rover.axles != len(WEAR)):
        (effect,) = hidden_effect(name, rover).plant.effects
        return effect, "the library's"
    sizes = SCALES[known.scale](rover) * sizes_of(known, 1.0, drives, generator)
    none = torch.zeros_like(sizes)
    return known.make(Draw(sizes, none.long(), none)), known.law


def found(
    turning: Turning, name: str, seed: int, drives: int, seconds: float, *, own: bool = False
) -> tuple[list[list[Observation]], Tensor, str]:
    """Return the observations of drives with a hidden effect, their strength, and the law."""
    generator, rover = torch.Generator().manual_seed(seed), turning.rover
    effect, law = hidden(name, rover, drives, generator, own=own)
    samples, strength, plant = driven(turning, effect, drives, seconds, generator)
    if isinstance(effect, Sensed):  # sensors have a row for each side of a rover
        effect.sizes = effect.sizes.repeat_interleave(rover.wheels_per_axle).unsqueeze(-1)
    in_chassis = chassis_places(rover)
    order = [in_chassis[k] for k in wheel_order(rover)]
    return observed(rover, samples, order, generator, plant), strength, law


def with_effect(plain: LoadedModel, name: str, folder: Path) -> LoadedModel:
    """Return the model with the effect, whose size has the library's prior."""
    path = folder / f"{name}.pt"
    add_effects(plain, [Sized.of_library(name)], path)
    return load_model(str(path))


def cells(result: Ended) -> tuple[str, ...]:
    """Return what a line says of the drives by one model, first of c, then of tan phi."""
    error = 100.0 * np.median(np.abs(result.mean / result.truth - 1.0), 0)
    held = result.holds.sum(0)
    wrong = result.identified & ~result.holds.all(1)
    return (
        f"{error[0]:.1f} / {error[1]:.1f} %",
        f"{held[0]} / {held[1]}",
        f"{result.identified.sum()}, {wrong.sum()}",
    )


def lines(
    turning: Turning,
    names: Sequence[str] = NAMES,
    drives: int = DRIVES,
    seconds: float = SECONDS,
    *,
    own: bool = False,
) -> Iterator[tuple[str, ...]]:
    """Yield the lines of a rover's table, one for each effect; ``own`` as in :func:`hidden`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        plain = model_by_wheel(turning.rover, turning.places, DEFAULT_PRIOR, path / "plain.pt")
        for name in names:
            seed = SEED + 100 * turning.kind + tuple(EFFECTS).index(name)
            observations, strength, law = found(turning, name, seed, drives, seconds, own=own)
            truth = strength.numpy()
            both = [
                cells(ended(model, observations, truth))
                for model in (with_effect(plain, name, path), plain)
            ]
            yield f"`{name}`", law, *both[0], *both[1]
