# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Draw a recorded run: estimates with their intervals against the truth, slip and sinkage below."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from terrain_estimator.bags import BagReader, Message
from terrain_estimator.topics import stamp_ns

mpl.use("Agg")  # no display: before pyplot is imported
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

Floats = NDArray[np.float64]
_ESTIMATE, _TRUTH = "#1f5fa8", "#c0392b"
# front, middle, rear: colours that colour-blind readers can distinguish
_AXLES = ("#1b7837", "#762a83", "#b35806")


@dataclass(frozen=True, slots=True)
class RunCurves:
    """Data of the figure; times in seconds from the first estimate."""

    time_s: Floats  # [estimates]
    cohesion_kpa: Floats  # [estimates, 3] mean, lower, upper
    tan_phi: Floats  # [estimates, 3]
    truth: list[tuple[float, float, float]]  # time of the change, c [kPa], tan phi
    wheels: list[str]
    slip_time_s: Floats
    slip: Floats  # [samples, wheels]
    sinkage_time_s: Floats
    sinkage_mm: Floats  # [samples, wheels]


def read_curves(bag: Path) -> RunCurves:
    """Read the data of the figure; BagError where the bag is unreadable or has no estimates."""
    with BagReader(bag) as reader:
        estimates, slips, sinkages, truths = (
            list(_decoded(reader, topic))
            for topic in (
                "/terrain_estimate",
                "/wheel_slip",
                "/wheel_sinkage",
                "/ground_truth/terrain",
            )
        )
    start_ns = stamp_ns(estimates[0])

    def times(messages: list[Message]) -> Floats:
        return np.array([(stamp_ns(message) - start_ns) * 1e-9 for message in messages])

    cohesion = [
        (each.cohesion, each.cohesion_lower_95, each.cohesion_upper_95) for each in estimates
    ]
    tan_phi = [(each.tan_phi, each.tan_phi_lower_95, each.tan_phi_upper_95) for each in estimates]
    return RunCurves(
        time_s=times(estimates),
        cohesion_kpa=np.array(cohesion) * 1e-3,
        tan_phi=np.array(tan_phi),
        truth=[
            (max(0.0, (stamp_ns(each) - start_ns) * 1e-9), each.cohesion * 1e-3, each.tan_phi)
            for each in truths
        ],
        wheels=list(slips[0].wheel),
        slip_time_s=times(slips),
        slip=np.array([each.slip for each in slips]),
        sinkage_time_s=times(sinkages),
        sinkage_mm=np.array([each.sinkage for each in sinkages]) * 1e3,
    )


def _decoded(reader: BagReader, topic: str) -> Iterator[Message]:
    return (reader.decode(raw) for raw in reader.messages([topic]))


def draw(curves: RunCurves, path: Path, title: str) -> None:
    """Draw to an image file; its suffix sets the format."""
    figure, ((cohesion, tan_phi), (slip, sinkage)) = plt.subplots(
        2, 2, figsize=(11.0, 6.5), sharex=True, layout="constrained"
    )
    figure.suptitle(title)
    _draw_estimate(
        cohesion,
        curves.time_s,
        curves.cohesion_kpa,
        [(time, value) for time, value, _ in curves.truth],
        "upper right",
    )
    _draw_estimate(
        tan_phi,
        curves.time_s,
        curves.tan_phi,
        [(time, value) for time, _, value in curves.truth],
        "lower right",
    )
    _draw_wheels(slip, curves.slip_time_s, curves.slip, curves.wheels)
    _draw_wheels(sinkage, curves.sinkage_time_s, curves.sinkage_mm, curves.wheels)
    for axes, label in (
        (cohesion, "cohesion c [kPa]"),
        (tan_phi, "tan(friction angle) [1]"),
        (slip, "slip [1]"),
        (sinkage, "sinkage [mm]"),
    ):
        axes.set_ylabel(label)
        axes.grid(visible=True, alpha=0.3)
    for axes in (slip, sinkage):
        axes.set_xlabel("time [s]")
    slip.set_xlim(0.0, float(curves.time_s[-1]))
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _draw_estimate(
    axes: Axes,
    time_s: Floats,
    values: Floats,
    truth: list[tuple[float, float]],
    legend: Literal["upper right", "lower right"],
) -> None:
    axes.fill_between(
        time_s,
        values[:, 1],
        values[:, 2],
        color=_ESTIMATE,
        alpha=0.22,
        linewidth=0.0,
        label="95 % interval",
    )
    axes.plot(time_s, values[:, 0], color=_ESTIMATE, label="estimate")
    if truth:
        axes.step(
            [*(time for time, _ in truth), float(time_s[-1])],
            [*(value for _, value in truth), truth[-1][1]],
            _TRUTH,
            where="post",
            label="truth",
        )
        axes.set_ylim(0.0, _upper_limit(values, max(value for _, value in truth)))
    axes.legend(loc=legend)


def _upper_limit(values: Floats, truth: float) -> float:
    """Return a limit above the truth and the settled interval; the prior's interval may be cut."""
    settled = values[len(values) // 10 :, 2]
    return float(1.15 * max(truth, np.max(settled)))


def _draw_wheels(axes: Axes, time_s: Floats, values: Floats, wheels: list[str]) -> None:
    """Draw every wheel thinly, and the mean of each axle over a second.

    An axle is the first word of its wheels' names.
    """
    axle_of = [name.split("_")[0] for name in wheels]
    for axle, colour in zip(dict.fromkeys(axle_of), itertools.cycle(_AXLES)):
        columns = values[:, [name == axle for name in axle_of]]
        axes.plot(time_s, columns, color=colour, linewidth=0.5, alpha=0.3)
        axes.plot(time_s, _smooth(columns.mean(axis=1)), color=colour, label=axle)
    low, high = np.nanpercentile(values, (0.5, 99.5)).tolist()
    axes.set_ylim(low - 0.15 * (high - low), high + 0.3 * (high - low))  # room for the legend
    axes.legend(loc="upper right", ncols=3)


def _smooth(values: Floats) -> Floats:
    """Return the mean of the ten samples around each, fewer at the ends; NaN where one is NaN."""
    kernel = np.ones(10)
    return np.asarray(
        np.convolve(values, kernel, "same") / np.convolve(np.ones_like(values), kernel, "same")
    )
