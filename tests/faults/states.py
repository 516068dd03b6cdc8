# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Saved states with hostile numbers behind a right sha256, and honest ones of hostile drives."""

import dataclasses
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.saved_state import StateFileError
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.observation import Observation
from tests.faults.hostile import MONSTERS, FaultyObservations
from tests.soundness import unsound
from tests.terrain_estimator.drives import drive_observations

Saved = dict[str, NDArray[Any]]
UPDATES = 12
"""Updates after each state that is taken, so that a block is closed."""
INTEGERS = (-1, -(2**62), 2**62, 7, 10**6)


@dataclass(slots=True)
class Result:
    """Results of hostile states."""

    states: int = 0
    refused: Counter[str] = field(default_factory=Counter)  # by the field that is named
    outcomes: Counter[str] = field(default_factory=Counter)  # of updates after those taken
    wrong: list[str] = field(default_factory=list)

    def __add__(self, other: "Result") -> "Result":
        return Result(
            self.states + other.states,
            self.refused + other.refused,
            self.outcomes + other.outcomes,
            self.wrong + other.wrong,
        )

    @property
    def taken(self) -> int:
        """Number of states that were not refused."""
        return self.states - self.refused.total()


def honest(model: LoadedModel, seed: int, number: int, config: CoreConfig) -> Iterator[Saved]:
    """Yield states of a drive with faulty sensors and clocks, as an estimator saves them."""
    estimator = Estimator(model, config)
    observations = FaultyObservations(model.rover, model.metadata.soils[0], seed).observations()
    generator = np.random.default_rng(seed)
    for _ in range(number):
        for observation in islice(observations, int(generator.integers(1, 30))):
            estimator.update(observation)
        yield estimator.save()


def refused_honest(model: LoadedModel, seed: int, number: int) -> list[str]:
    """Return why honest states are refused, which must not be; empty where all are taken."""
    config = CoreConfig(forgetting_time=(0.0, 100.0, 1.0)[seed % 3])
    estimator, reasons = Estimator(model, config), []
    for saved in honest(model, seed, number, config):
        try:
            estimator.restore(saved)
        except StateFileError as error:
            reasons.append(f"seed {seed}: {error}")
    return reasons


def hostile(saved: Saved, generator: np.random.Generator) -> tuple[Saved, str]:
    """Return a state with one to three changed arrays, and words about them."""
    changed, words = dict(saved), []
    names = sorted(saved)
    for name in generator.choice(names, size=generator.integers(1, 4), replace=False).tolist():
        ways = (_whole, _one, _scaled, _rows, _type, _other)
        way = ways[generator.choice(len(ways), p=[0.3, 0.3, 0.2, 0.1, 0.05, 0.05])]
        changed[name], how = way(saved[name], generator, saved)
        words.append(f"{name} {how}")
    return changed, ", ".join(words)


def _value(array: NDArray[Any], generator: np.random.Generator) -> float | int:
    if array.dtype.kind == "f":
        return float(generator.choice(MONSTERS) * generator.choice([-1.0, 1.0]))
    return int(generator.choice(INTEGERS)) if array.dtype.kind == "i" else 1


def _whole(array: NDArray[Any], generator: np.random.Generator, _: Saved) -> tuple[Any, str]:
    value = _value(array, generator)
    return np.full_like(array, value), f"= {value:g}"


def _one(array: NDArray[Any], generator: np.random.Generator, _: Saved) -> tuple[Any, str]:
    if not array.size:
        return array, "as it was"
    changed, value, place = array.copy(), _value(array, generator), generator.integers(array.size)
    changed.reshape(-1)[place] = value
    return changed, f"[{place}] = {value:g}"


def _scaled(array: NDArray[Any], generator: np.random.Generator, _: Saved) -> tuple[Any, str]:
    if array.dtype.kind != "f":
        return array[..., ::-1] if array.ndim else array, "reversed"
    factor = 10.0 ** generator.uniform(-300.0, 300.0) if generator.random() < 0.3 else (
        10.0 ** generator.uniform(-6.0, 6.0)
    )  # fmt: skip
    factor *= generator.choice([-1.0, 1.0])
    with np.errstate(over="ignore", invalid="ignore"):
        return array * array.dtype.type(factor), f"times {factor:g}"


def _rows(array: NDArray[Any], generator: np.random.Generator, _: Saved) -> tuple[Any, str]:
    if not array.ndim:
        return array.reshape(1), "with an axis"
    rows = int(generator.choice([0, 1, 2, 60]))
    return np.resize(array, (rows, *array.shape[1:])), f"of {rows} rows"


def _type(array: NDArray[Any], generator: np.random.Generator, _: Saved) -> tuple[Any, str]:
    kind = str(generator.choice([">f8", "f4", "i8", "?", "c16", "U4", "u2"]))
    with np.errstate(all="ignore"):
        return np.zeros(array.shape, kind), f"of type {kind}"


def _other(_: NDArray[Any], generator: np.random.Generator, saved: Saved) -> tuple[Any, str]:
    name = str(generator.choice(sorted(saved)))
    return saved[name], f"= {name}"


def run(model: LoadedModel, states: int, seed: int) -> Result:
    """Restore hostile states, and drive on from those that are taken."""
    generator, result, types = np.random.default_rng(seed), Result(), Types()
    drive = drive_observations(model.rover, model.metadata.soils[0], 3.0, seed)
    config = EstimatorConfig()
    pipeline = Pipeline(model, config)
    sources = list(honest(model, seed, max(4, states // 50), config.core))
    for number in range(states):
        arrays, words = hostile(sources[generator.integers(len(sources))], generator)
        result.states += 1
        try:
            pipeline.restore(arrays, "state")
        except StateFileError as error:
            named = str(error).removeprefix("state: the state's ").split(" ")[0]
            result.refused[named] += 1
            continue
        except Exception as error:  # noqa: BLE001 - what must not come
            result.wrong.append(f"state {number} ({words}): {type(error).__name__}: {error}")
            continue
        result.wrong += [
            f"state {number} ({words}): {text}" for text in _driven(pipeline, drive, types, result)
        ]
    return result


def _driven(
    pipeline: Pipeline, drive: list[Observation], types: Types, result: Result
) -> Iterator[str]:
    """Yield what is wrong with the updates after a state that was taken."""
    last = pipeline.save()["counts"][0]
    for step, observation in enumerate(drive[:UPDATES]):
        stamp = min(int(last), 2**60) + (step + 1) * 10**8
        try:
            answer = pipeline.answer(
                Conversion(stamp, dataclasses.replace(observation, stamp_ns=stamp))
            )
        except Exception as error:  # noqa: BLE001 - what must not come
            yield f"{type(error).__name__}: {error}"
            return
        result.outcomes[answer.update.decision.outcome.name] += 1
        if stamp < 2**31 * 10**9:
            for message in answer.messages(types.make, pipeline.meta).values():
                yield from unsound(message)
