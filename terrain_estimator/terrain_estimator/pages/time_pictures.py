# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a run over time: a value with its bands, curves, and occurrences."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from terrain_estimator.pages.number_format import finite
from terrain_estimator.pages.pictures import (
    AFTER,
    BEFORE,
    INK,
    LOOK,
    QUIET,
    WIDTH_INCH,
    Picture,
    PlotSeries,
    Table,
    inline,
    legend,
)

TABLE_ROWS = 24
"""Approximate number of rows in a picture's table; the picture has more points."""
_LEGEND = 4  # names in a row; longer lists have rows of three
_TIME = "time [s]"
_SETTLED = 0.1
"""[1] Share of a run after which its bands must fit into the picture; the prior's may not."""


@dataclass(frozen=True, slots=True)
class Course:
    """A value over time with its bands and its truth, NaN where unknown; all of one length."""

    time_s: Sequence[float]
    mean: Sequence[float]
    band_68: tuple[Sequence[float], Sequence[float]]
    band_95: tuple[Sequence[float], Sequence[float]]
    truth: Sequence[float]
    withheld: Sequence[bool]  # where the prior stands, as the model does not fit


def bands(name: str, title: str, course: Course, axis: str) -> Picture:
    """Draw the mean in its bands of 68 and 95 %, with the truth as a dashed line."""
    known = any(map(math.isfinite, course.truth))
    with _drawn() as (figure, axes):
        for (low, high), alpha, label in (
            (course.band_95, 0.22, "95 %"),
            (course.band_68, 0.35, "68 %"),
        ):
            axes.fill_between(
                course.time_s, low, high, color=AFTER, alpha=alpha, linewidth=0.0, label=label
            )
        axes.plot(course.time_s, course.mean, color=AFTER, label="estimate")
        if any(course.withheld):
            axes.fill_between(
                course.time_s,
                0.0,
                1.0,
                where=list(course.withheld),
                step="pre",
                transform=axes.get_xaxis_transform(),
                facecolor="none",
                edgecolor=QUIET,
                hatch="///",
                linewidth=0.0,
                label="no estimate: the prior",
            )
        if known:
            axes.step(
                course.time_s,
                course.truth,
                color=INK,
                linestyle="--",
                linewidth=1.3,
                where="pre",
                label="truth",
            )
        axes.set_ylim(*_limits(course))
        _finish(figure, axes, axis, course.time_s)
        svg = inline(figure, name)
    head = (_TIME, "estimate", "68 % from", "to", "95 % from", "to", "truth")
    columns = (course.mean, *course.band_68, *course.band_95, course.truth)
    truth = f"; the truth there is {course.truth[-1]:.3g}" if known else ""
    if any(course.withheld):
        share = sum(course.withheld) / len(course.withheld)
        truth += f"; in {share:.0%} of the time it is the prior, as the model does not fit"
    words = (
        f"{title} over {course.time_s[-1]:.0f} s: from {course.mean[0]:.3g} to"
        f" {course.mean[-1]:.3g}, at the end with 95 % between {course.band_95[0][-1]:.3g} and"
        f" {course.band_95[1][-1]:.3g}{truth}. {axis}. The numbers are in the table."
    )
    return Picture(name, title, words, svg, _table(head, course.time_s, columns))


def curves(
    name: str,
    title: str,
    time_s: Sequence[float],
    series: Sequence[PlotSeries],
    axis: str,
    marks_s: Sequence[float] = (),
    top: float | None = None,
) -> Picture:
    """Draw curves from zero, or from the lowest value below it; ``top`` ends the axis.

    A dotted vertical line marks each of ``marks_s``, where the true ground changed.
    """
    with _drawn() as (figure, axes):
        for each in series:
            heights = [math.nan if value is None else value for value in each.values]
            look: dict[str, Any] = {
                "color": each.colour,
                "linestyle": each.dash,
                "marker": each.marker,
                "markevery": 0.13,
                "markersize": 4,
            }
            axes.plot(time_s, heights, label=each.name, **look)
        for k, mark in enumerate(marks_s):
            axes.axvline(
                mark, color=INK, linestyle=":", linewidth=1.3, label=None if k else "true change"
            )
        axes.set_ylim(bottom=min(0.0, axes.dataLim.y0), top=top)
        _finish(figure, axes, axis, time_s)
        svg = inline(figure, name)
    marked = (
        f" The true ground changes at {', '.join(f'{mark:.0f} s' for mark in marks_s)}."
        if marks_s
        else ""
    )
    words = (
        f"{title}: {', '.join(map(_said, series))}. {axis} over {_TIME}.{marked} The numbers are in"
        " the table."
    )
    table = _table(
        (_TIME, *(each.name for each in series)), time_s, [each.values for each in series]
    )
    return Picture(name, title, words, svg, table)


def occurrences(
    name: str, title: str, ends_s: Sequence[float], counts: Mapping[str, Sequence[int]]
) -> Picture:
    """Draw a row for each kind of occurrence, with a bar at each.

    ``counts`` are those in the spans that end at ``ends_s``.
    """
    starts, end = [0.0, *ends_s[:-1]], _end(ends_s)
    stretches = {what: _stretches(starts, ends_s, of_span) for what, of_span in counts.items()}
    least = end / 150.0  # a single occurrence must be visible
    with mpl.rc_context(LOOK):
        figure = Figure(figsize=(WIDTH_INCH, 0.75 + 0.27 * len(counts)), layout="constrained")
        axes = figure.subplots()
        for row, what in enumerate(counts):
            places = [(start, max(stop - start, least)) for start, stop in stretches[what]]
            axes.broken_barh(
                places, (row - 0.3, 0.6), color=BEFORE if row else AFTER, linewidth=0.0
            )
        axes.set_yticks(range(len(counts)), list(counts))
        axes.set_ylim(len(counts) - 0.5, -0.5)
        axes.tick_params(axis="y", length=0)
        axes.set_xlim(0.0, end)
        axes.grid(axis="x")
        axes.set_axisbelow(True)
        axes.set_xlabel(_TIME)
        axes.xaxis.set_major_locator(MaxNLocator(6))
        svg = inline(figure, name)
    rows = tuple(
        (what, sum(counts[what]), each[0][0], each[-1][1]) for what, each in stretches.items()
    )
    listed = (f"{what} {total} times, from {a:.0f} to {b:.0f} s" for what, total, a, b in rows)
    words = f"{title}: {'; '.join(listed)}."
    return Picture(
        name, title, words, svg, Table(("", "observations", "first [s]", "last [s]"), rows)
    )


@contextmanager
def _drawn() -> Iterator[tuple[Figure, Axes]]:
    with mpl.rc_context(LOOK):
        figure = Figure(figsize=(WIDTH_INCH, 0.6 * WIDTH_INCH), layout="constrained")
        yield figure, figure.subplots()


def _finish(figure: Figure, axes: Axes, axis: str, time_s: Sequence[float]) -> None:
    axes.set(xlabel=_TIME, ylabel=axis, xlim=(0.0, _end(time_s)))
    axes.grid(visible=True, color=QUIET)
    axes.set_axisbelow(True)
    count = len(axes.get_legend_handles_labels()[1])
    legend(figure, count if count <= _LEGEND else 3, handletextpad=0.4, columnspacing=1.0)


def _end(time_s: Sequence[float]) -> float:
    """Return the end of the time axis, above zero even for a single instant."""
    return max(*time_s, 1e-3)


def _limits(course: Course) -> tuple[float, float]:
    """Return limits with room for the truth and for the bands after the first part of the run."""
    first = int(_SETTLED * len(course.mean))
    low = float(np.nanmin([*course.band_95[0][first:], *course.truth]))
    high = float(np.nanmax([*course.band_95[1][first:], *course.truth]))
    margin = 0.15 * (high - low) + 1e-9
    return max(0.0, low - margin), high + margin


def _table(
    head: tuple[str, ...], time_s: Sequence[float], columns: Sequence[Sequence[float | None]]
) -> Table:
    """Return a table of evenly spaced points, and the last one."""
    every = max(1, len(time_s) // TABLE_ROWS)
    chosen = sorted({*range(0, len(time_s), every), len(time_s) - 1})
    return Table(
        head,
        tuple((f"{time_s[k]:.1f}", *(_known(column[k]) for column in columns)) for k in chosen),
    )


def _known(value: float | None) -> float | None:
    return None if value is None else finite(value)


def _said(series: PlotSeries) -> str:
    known = [value for value in map(_known, series.values) if value is not None]
    return (
        f"{series.name} at most {max(known):.3g}, at the end {known[-1]:.3g}"
        if known
        else f"{series.name} not known"
    )


def _stretches(
    starts: Sequence[float], ends: Sequence[float], counts: Sequence[int]
) -> list[tuple[float, float]]:
    """Return beginnings and ends of the stretches with a count, with neighbouring spans merged."""
    found: list[tuple[float, float]] = []
    for start, end, count in zip(starts, ends, counts, strict=True):
        if count and found and found[-1][1] == start:
            found[-1] = (found[-1][0], end)
        elif count:
            found.append((start, end))
    return found
