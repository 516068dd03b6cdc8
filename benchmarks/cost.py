# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Growth of time with features, wheels, bags and length of a run: docs/images/cost.png."""

import contextlib
import io
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import torch
from matplotlib.figure import Figure

from benchmarks.drives import long_drive, observations
from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.observation import microseconds, widened
from terrain_estimator.bags import Types
from terrain_estimator.cli import replay
from terrain_estimator.model.model_file import load_model
from terramechanics.contact.sinkage import WheelGround, equilibrium_sinkage
from terramechanics.presets import load_rover, load_soil
from tests.drives import write_bag

STEEPEST = 1.1
"""[1] Exponent of growth that counts as linear."""
RUNS = 3  # the fastest counts
PICTURE = Path("docs/images/cost.png")


@dataclass(frozen=True, slots=True)
class Growth:
    """Time against size."""

    what: str
    unit: str
    sizes: Sequence[float]
    seconds: Sequence[float]

    @property
    def exponent(self) -> float:
        """Exponent p of time ~ size^p, over the upper half of the sizes."""
        upper = slice(len(self.sizes) // 2 - 1, None)
        return float(np.polyfit(np.log(self.sizes[upper]), np.log(self.seconds[upper]), 1)[0])


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the exponents; only a whole run draws the picture."""
    torch.set_num_threads(1)
    found = [by_features(effort), by_wheels(effort), by_bags(effort), by_length(effort)]
    if effort.scale == 1.0:
        draw(found, PICTURE)
    for growth in found:
        what = f"time ~ ({growth.what})^p: p"
        note = (
            f"{growth.sizes[0]:g} to {growth.sizes[-1]:g}, {growth.seconds[0]:.3g} to"
            f" {growth.seconds[-1]:.3g} s"
        )
        yield BenchmarkLine(
            what, growth.exponent, "1", STEEPEST, reference="linear cost", against=1.0, note=note
        )
    many, few = (effort.count(size, least=100) for size in (100_000, 1000))
    each = {size: min(_sinkage_s(size) for _ in range(RUNS)) / size * 1e6 for size in (few, many)}
    yield BenchmarkLine(
        f"time of a wheel in a batch of {many}",
        each[many],
        "us",
        STEEPEST * each[few],
        reference=f"in a batch of {few}",
        against=each[few],
    )


def by_features(effort: Effort) -> Growth:
    """Measure the mean time of an observation with models of more and more parameters."""
    model = load_model()
    seen = observations(model, effort.seconds(30.0, least=4.0))
    sizes = [17, 20, 26, 38, 62][: effort.count(5, least=2)]
    with tempfile.TemporaryDirectory() as folder:
        models = [widened(model, size, Path(folder)) for size in sizes]
    return Growth(
        "parameters of the model",
        "",
        sizes,
        [float(np.mean(microseconds(each, seen))) / 1e6 for each in models],
    )


def by_wheels(effort: Effort) -> Growth:
    """Measure the sinkage of more and more wheels at once under their load."""
    sizes = [10**power for power in range(1, 6)][: effort.count(5, least=2)]
    return Growth("wheels", "", sizes, [_sinkage_s(size) for size in sizes])


def by_bags(effort: Effort) -> Growth:
    """Measure the replay of more and more bags in one command."""
    sizes = [1, 2, 4, 8][: effort.count(4, least=2)]
    return Growth(
        "bags", "", sizes, [_replayed_s(effort.seconds(60.0, least=5.0), size) for size in sizes]
    )


def by_length(effort: Effort) -> Growth:
    """Measure the replay of longer and longer runs."""
    spans = [
        effort.seconds(60.0, least=5.0) * 4**power for power in range(effort.count(4, least=2))
    ]
    return Growth("run length", "s", spans, [_replayed_s(span, 1) for span in spans])


def draw(found: Sequence[Growth], path: Path) -> None:
    """Draw a panel for each on logarithmic axes, with linear cost through the last point."""
    with mpl.rc_context({"svg.hashsalt": "cost", "font.size": 9}):
        figure = Figure(figsize=(9.0, 2.6), layout="constrained")
        for axes, growth in zip(np.atleast_1d(figure.subplots(1, len(found))), found, strict=True):
            sizes, seconds = np.array(growth.sizes, dtype=float), np.array(growth.seconds)
            axes.loglog(sizes, seconds, "o-", label=f"measured, p = {growth.exponent:.2f}")
            axes.loglog(
                sizes, seconds[-1] * sizes / sizes[-1], "k--", linewidth=0.8, label="linear"
            )
            axes.set_xticks(sizes, [f"{size:g}" for size in sizes], fontsize=7)
            axes.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
            axes.set_xlabel(f"{growth.what} [{growth.unit}]" if growth.unit else growth.what)
            axes.legend(frameon=False, fontsize=7)
        figure.axes[0].set_ylabel("time [s]")
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110, metadata={"Software": None})


def _sinkage_s(wheels: int) -> float:
    """Return the time for wheels of the Mars rover on loose sand, evenly loaded."""
    rover, soil = load_rover("mars_rover"), load_soil("loose_sand")
    wheel = WheelGround.of(rover, soil.constants(), soil.strength(), 12)
    slip = torch.linspace(0.05, 0.6, wheels, dtype=torch.float64)
    load = torch.full_like(slip, rover.weight / len(rover.wheels))
    spent = []
    for _ in range(RUNS):
        begun_s = time.thread_time()
        equilibrium_sinkage(wheel, slip, load)
        spent.append(time.thread_time() - begun_s)
    return min(spent)


def _replayed_s(span_s: float, bags: int) -> float:
    types = Types()
    with tempfile.TemporaryDirectory() as name:
        drives = [
            write_bag(Path(name) / f"drive_{seed}", long_drive(types.make, span_s, seed), types)
            for seed in range(1, bags + 1)
        ]
        begun_s = time.perf_counter()
        with contextlib.redirect_stdout(io.StringIO()):  # its table
            code = replay.main([*map(str, drives), "--out", str(Path(name) / "estimates")])
        spent_s = time.perf_counter() - begun_s
    if code:
        raise ArithmeticError(f"replay of {bags} bags ended with code {code}")
    return spent_s
