# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures from the results of a run, as PNG."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
import torch
from matplotlib.axes import Axes

from studies.paper.cases import PAPER_STRENGTH, strength_name
from studies.paper.experiment import CellResult
from studies.paper.plants import PaperPlant
from studies.paper.published import TRADE_OFF
from terramechanics.simulation.sample import TIME_STEP

SHOWN = (
    "linear",
    "Iagnemma",
    strength_name(0.0),
    strength_name(PAPER_STRENGTH),
    "P-ALPaCA, projected",
    "integrated",
    "integrated, quadrature",
)
"""Methods in the pictures of estimates."""
WITH_INTERVAL = (strength_name(0.0), strength_name(PAPER_STRENGTH), "integrated")
"""Methods whose 95 % intervals are drawn; more would overlap."""
PREDICTING = (
    "constant guess",
    "linear",
    "ALPaCA",
    strength_name(0.0),
    strength_name(PAPER_STRENGTH),
    "integrated",
)
"""Methods in the picture of predictions."""


def draw_all(results: list[CellResult], folder: Path) -> list[Path]:
    """Write every picture; returns their paths."""
    paths = []
    for plant in PaperPlant:
        chosen = [result for result in results if result.cell.plant is plant]
        stem = plant.name.lower()
        for name, draw in (
            ("estimates", _estimates),
            ("errors", _errors),
            ("velocity", _velocity),
            ("trade_off", _trade_off),
        ):
            paths.append(folder / f"{name}_{stem}.png")
            draw(chosen, paths[-1])
    return paths


@contextmanager
def _axes(path: Path, rows: int, columns: int, title: str) -> Iterator[list[list[Axes]]]:
    """A grid of axes, saved at the end."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415 (after the choice of a backend without display)

    figure, axes = plt.subplots(
        rows, columns, figsize=(6.5 * columns, 3.6 * rows), layout="constrained", squeeze=False
    )
    figure.suptitle(title)
    yield [list(row) for row in axes]
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _estimates(results: list[CellResult], path: Path) -> None:
    """Estimates over time of the first test drive, with 95 % intervals."""
    with _axes(path, 2, len(results), f"{results[0].cell.plant.value} plant, one drive") as axes:
        for column, result in enumerate(results):
            for row, (label, truth) in enumerate(
                (
                    ("c [kPa]", result.truth[0] / 1e3),
                    ("phi [deg]", torch.rad2deg(torch.atan(result.truth[1]))),
                )
            ):
                ax = axes[row][column]
                ax.axhline(
                    float(truth), color="black", linestyle="--", linewidth=1.0, label="truth"
                )
                for number, name in enumerate(SHOWN):
                    _estimate(ax, result, name, row, f"C{number}")
                ax.set(
                    ylabel=label,
                    xlabel="time [s]",
                    title=result.cell.soil.replace("_", " "),
                    ylim=(0.0, 3.0 * float(truth)),
                )


def _estimate(ax: Axes, result: CellResult, name: str, row: int, colour: str) -> None:
    curves = result.curves.get(name)
    if curves is None or curves.example is None:
        return
    value = curves.example[:, row]
    deviation = (
        None
        if curves.example_sd is None or name not in WITH_INTERVAL
        else 1.96 * curves.example_sd[:, row]
    )

    def shown(x: torch.Tensor) -> torch.Tensor:
        return x / 1e3 if row == 0 else torch.rad2deg(torch.atan(x))

    time = TIME_STEP * torch.arange(1, value.shape[0] + 1)
    ax.plot(time, shown(value), color=colour, linewidth=1.0, label=name)
    if deviation is not None:
        ax.fill_between(
            time.numpy(),
            shown(value - deviation).numpy(),
            shown(value + deviation).numpy(),
            color=colour,
            alpha=0.12,
            linewidth=0,
        )


def _errors(results: list[CellResult], path: Path) -> None:
    """Draw errors over time, medians with quartiles over the test drives."""
    with _axes(
        path,
        2,
        len(results),
        f"{results[0].cell.plant.value} plant, median and quartiles of the test drives",
    ) as axes:
        for column, result in enumerate(results):
            for row, label in enumerate(("error of c [%]", "error of phi [%]")):
                ax = axes[row][column]
                for number, name in enumerate(SHOWN):
                    curves = result.curves.get(name)
                    error = (
                        None if curves is None else (curves.cohesion_error, curves.angle_error)[row]
                    )
                    if error is None:
                        continue
                    time = TIME_STEP * torch.arange(1, error.shape[1] + 1)
                    ax.semilogy(time, error[1], color=f"C{number}", linewidth=1.0, label=name)
                    ax.fill_between(
                        time.numpy(),
                        error[0].numpy(),
                        error[2].numpy(),
                        color=f"C{number}",
                        alpha=0.12,
                        linewidth=0,
                    )
                ax.set(
                    ylabel=label,
                    xlabel="time [s]",
                    title=result.cell.soil.replace("_", " "),
                    ylim=(0.5, 1000.0),
                )


def _velocity(results: list[CellResult], path: Path) -> None:
    """Draw the one-step prediction error, averaged over a second."""
    with _axes(
        path,
        1,
        len(results),
        f"{results[0].cell.plant.value} plant, one-step prediction of velocity",
    ) as axes:
        for ax, result in zip(axes[0], results, strict=True):
            for name in PREDICTING:
                error = result.curves[name].velocity_error
                if error is None:
                    continue
                seconds = error[: error.shape[0] // 10 * 10].view(-1, 10).mean(1)
                ax.semilogy(
                    torch.arange(1, seconds.shape[0] + 1), seconds, linewidth=1.0, label=name
                )
            ax.set(
                ylabel="median |error| [mm/s]",
                xlabel="time [s]",
                title=result.cell.soil.replace("_", " "),
            )


def _whiskers(values: list[float]) -> list[list[float]]:
    """Return the lengths below and above the median, for errorbar."""
    low, middle, high = values
    return [[middle - low], [high - middle]]


def _trade_off(results: list[CellResult], path: Path) -> None:
    """Draw prediction against estimation error over the strengths of the paper's penalty.

    The paper's own points are in the second panel.
    """
    loose = next(result for result in results if result.cell.soil == "loose_sand")
    with _axes(
        path, 1, 2, f"{loose.cell.plant.value} plant, loose sand: strength of orthogonality"
    ) as axes:
        ours, paper = axes[0]
        for number, (name, point) in enumerate(TRADE_OFF.items()):
            scores = loose.testing[name]
            x, y = scores["velocity_rms_mm_s"], scores["error_percent"]
            if isinstance(x, list) and isinstance(y, list):
                ours.errorbar(
                    x[1],
                    y[1],
                    xerr=_whiskers(x),
                    yerr=_whiskers(y),
                    marker="s",
                    color=f"C{number}",
                    label=name,
                )
            paper.plot(*point, marker="s", linestyle="none", color=f"C{number}", label=name)
        ours.set(
            xlabel="one-step velocity error [mm/s]",
            ylabel="mean error of c and phi [%]",
            title="here: median and quartiles",
        )
        paper.set(
            xlabel="prediction error [%]",
            ylabel="parameter estimation error [%]",
            title="the paper",
            xlim=(0.0, 4.5),
        )
