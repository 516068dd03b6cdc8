# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Processor time of one observation in the estimator, warm, on one thread.

The compiled core stands beside TorchScript, TorchScript beside one update in NumPy.
"""

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.drives import observations
from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.numpy_training import Floats
from rover_sim_node.config import FOLLOW, SimulatorConfig
from rover_sim_node.turning_run import TurningRun
from terrain_estimator.compiled.finding import ends_here, load
from terrain_estimator.compiled.folder import build_core, flags_by_end, write_core
from terrain_estimator.config.estimator import COMPILED, EstimatorConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.by_wheel import build_model_by_wheel
from terrain_estimator.learning.export import export
from terrain_estimator.learning.training import build_model
from terrain_estimator.messaging.pipeline import warm_up
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Training
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terramechanics.presets import load_rover, load_soil
from terramechanics.vehicle.wheel_places import WheelPlaces
from tests.turning_drives import turning_observations

TURNS = ((0.08, 0.0), (0.1, 0.04), (0.08, 0.0), (0.1, -0.04))
"""[m/s], [rad/s] Commands of a drive in turns, one after the other."""
BY_WHEEL_US = 60.0
MEDIAN_US, CLOSING_US, HIGH_US = 40.0, 300.0, 400.0
SECONDS = 120.0


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield median, median of those that close a block, and 99th percentile, of both runtimes."""
    torch.set_num_threads(1)
    reference = load_model()
    seen = observations(reference, effort.seconds(SECONDS, least=5.0))
    closes = closing(reference, seen)
    note = f"processor time; {np.count_nonzero(closes)} of {len(seen)} observations close a block"
    slow = _figures(microseconds(reference, seen), closes)
    quick = _figures(microseconds(load("", COMPILED).model, seen), closes)
    bars = (MEDIAN_US, CLOSING_US, HIGH_US)
    for (what, value), bar, against in zip(quick.items(), bars, slow.values(), strict=True):
        yield BenchmarkLine(
            f"one observation, compiled core: {what}",
            value,
            "us",
            bar,
            reference="TorchScript",
            against=against,
            note=note,
        )
    yield from by_wheel(effort)
    size = len(reference.metadata.parameters)
    update = numpy_update(size, len(reference.rows))
    for what, value in slow.items():
        yield BenchmarkLine(
            f"one observation, TorchScript: {what}",
            value,
            "us",
            None,
            reference=f"one information-form update of {size} parameters in NumPy",
            against=update,
            note=note,
        )


def by_wheel(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the figures of a model by wheel of six wheels, all of them steered."""
    rover, soil = load_rover("mars_rover"), load_soil("loose_sand")
    places = WheelPlaces.of(rover, 1.0, rover.wheel_names)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "by_wheel.pt"
        model = build_model_by_wheel(rover, places, [soil])
        export(model, rover, [soil], Training(0, 0, 0.0, torch.__version__), path, places)
        reference, core = load_model(str(path)), Path(folder) / "core"
        write_core(path, core)
        end = ends_here()[0]
        build_core(core, path.with_suffix(end), *flags_by_end()[end])
        run = TurningRun(
            SimulatorConfig(
                rover=rover.name, steering="all_wheels", schedule=FOLLOW, profile="hills"
            )
        )
        seconds = effort.seconds(SECONDS, least=5.0) / len(TURNS)
        seen = turning_observations(reference, run, TURNS, seconds)
        closes = closing(reference, seen)
        slow = _figures(microseconds(reference, seen), closes)
        quick = _figures(microseconds(load(str(path), COMPILED).model, seen), closes)
    for bar, (what, value) in zip((BY_WHEEL_US, None, None), quick.items(), strict=True):
        yield BenchmarkLine(
            f"one observation by wheel, six wheels, compiled core: {what}",
            value,
            "us",
            bar,
            reference="TorchScript",
            against=slow[what],
            note=f"processor time; {np.count_nonzero(closes)} of {len(seen)} close a block",
        )


def _figures(spent: Floats, closes: NDArray[np.bool_]) -> dict[str, float]:
    return {
        "median": float(np.median(spent)),
        "median of those that close a block": float(np.median(spent[closes])),
        "99th percentile": float(np.quantile(spent, 0.99)),
    }


def microseconds(model: LoadedModel, seen: list[Observation]) -> Floats:
    """Return the processor time of every update of a drive [us]."""
    config = EstimatorConfig()
    warm_up(model, config)
    estimator = Estimator(model, config.core)
    spent = []
    for observation in seen:
        begun_s = time.thread_time()
        estimator.update(observation)
        spent.append(1e6 * (time.thread_time() - begun_s))
    return np.array(spent)


def closing(model: LoadedModel, seen: list[Observation]) -> NDArray[np.bool_]:
    """Return which updates of that drive close a block.

    Afterwards fewer observations wait in the open block, whatever was refused before. Raises
    ArithmeticError where no update does.
    """
    estimator = Estimator(model, EstimatorConfig().core)
    waiting = [0]
    for observation in seen:
        estimator.update(observation)
        waiting.append(len(estimator.save()["state.block"]))
    closes = np.diff(waiting) < 0
    if not closes.any():
        raise ArithmeticError(
            f"none of {len(seen)} observations closes a block of the model {model.model_id}"
        )
    return closes


def widened(model: LoadedModel, parameters: int, folder: Path) -> LoadedModel:
    """Return an untrained model whose net has so many columns more or less."""
    metadata = model.metadata
    columns = (
        parameters
        - len(metadata.parameters)
        + sum(name.startswith("net_") for name in metadata.parameters)
    )
    built = build_model(metadata.rover, metadata.soils, columns, hidden=128)
    path = folder / f"of_{parameters}.pt"
    export(
        built.requires_grad_(requires_grad=False),
        metadata.rover,
        metadata.soils,
        Training(0, 0, 0.0),
        path,
    )
    return load_model(str(path))


def numpy_update(parameters: int, rows: int, runs: int = 300) -> float:
    """Return the median time [us] of precision += A' A, pull += A' y and one solve."""
    generator = np.random.default_rng(0)
    features, target = (
        generator.standard_normal((rows, parameters)),
        generator.standard_normal(rows),
    )
    precision, pull, spent = np.eye(parameters), np.zeros(parameters), []
    for _ in range(runs):
        begun_s = time.thread_time()
        precision, pull = precision + features.T @ features, pull + features.T @ target
        np.linalg.solve(precision, pull)
        spent.append(1e6 * (time.thread_time() - begun_s))
    return float(np.median(spent))
