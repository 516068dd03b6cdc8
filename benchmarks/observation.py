# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Processor time of one observation in the core, warm, on one thread, with two models.

The models are the installed one, and one of 34 parameters.
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
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.export import export
from terrain_estimator.learning.training import build_model
from terrain_estimator.messaging.pipeline import warm_up
from terrain_estimator.model.model_file import LoadedModel, Training, load_model
from terrain_estimator.observation import Observation

MEDIAN_US, CLOSING_US, HIGH_US = 150.0, 1000.0, 2000.0
PARAMETERS = 34
SECONDS = 120.0


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield median, median of those that close a block, and 99th percentile, of two models."""
    torch.set_num_threads(1)
    installed = load_model()
    seen = observations(installed, effort.seconds(SECONDS, least=5.0))
    with tempfile.TemporaryDirectory() as folder:
        wide = widened(installed, PARAMETERS, Path(folder))
    for model in (installed, wide):
        size = len(model.metadata.parameters)
        spent, closes = microseconds(model, seen), closing(model, seen)
        update = numpy_update(size, len(model.rows))
        name = "one information-form update of as many parameters in NumPy"
        note = (
            f"processor time; {np.count_nonzero(closes)} of {len(seen)} observations close a block"
        )
        for what, value, bar in (
            ("median", np.median(spent), MEDIAN_US),
            ("median of those that close a block", np.median(spent[closes]), CLOSING_US),
            ("99th percentile", np.quantile(spent, 0.99), HIGH_US),
        ):
            yield BenchmarkLine(
                f"one observation in the core, {size} parameters: {what}",
                float(value),
                "us",
                bar,
                reference=name,
                against=update,
                note=note,
            )


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
