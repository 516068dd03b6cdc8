# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures as inline SVG in the variables of the page's style, for light and dark.

Every picture has a description for screen readers, and a table of its numbers.
"""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

WIDTH_INCH = 4.6
"""[inch] About a phone's width at its text size; wider screens enlarge it by half at most."""
_ROW_INCH = 0.27
_MARGIN_INCH = 0.75
_COLOURS = {
    "#010101": "ink",
    "#020202": "quiet",
    "#030303": "before",
    "#040404": "after",
    "#050505": "accent",
}
"""Placeholder colours of the drawing, and the variables of style.css that replace them."""
INK, QUIET, BEFORE, AFTER, ACCENT = _COLOURS
LOOK: dict[Any, Any] = {
    "svg.hashsalt": "page",  # equal pictures have equal bytes
    "svg.fonttype": "none",  # text stays text: searchable, readable aloud, in the reader's font
    "text.parse_math": False,  # names of runs are not formulas
    "font.size": 9.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": QUIET,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.5,
    "grid.color": QUIET,
    "grid.alpha": 0.35,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.formatter.useoffset": False,
}


@dataclass(frozen=True, slots=True)
class Table:
    """Numbers behind a picture; a cell is text or a number, None for an unknown one."""

    head: tuple[str, ...]
    rows: tuple[tuple[str | float | None, ...], ...]


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture."""

    name: str  # identifier on the page
    title: str
    words: str  # description for screen readers
    svg: Markup
    table: Table


@dataclass(frozen=True, slots=True)
class PlotSeries:
    """Values for labels or places, with half widths of their intervals; None for a missing one."""

    name: str
    values: Sequence[float | None]
    colour: str
    marker: str  # a different one for each colour
    halves: Sequence[float | None] = ()
    dash: str = "-"


def bars(
    name: str, title: str, labels: Sequence[str], values: Sequence[float], axis: str
) -> Picture:
    """Draw a horizontal bar for each label, the first on top."""
    with mpl.rc_context(LOOK):
        figure, axes = _rows(labels, axis)
        axes.barh(range(len(labels)), values, color=ACCENT, height=0.6)
        svg = inline(figure, name)
    largest = labels[max(range(len(values)), key=lambda k: abs(values[k]))]
    words = (
        f"{title}: {len(labels)} bars, the longest is {largest} with {max(values, key=abs):.3g}."
        f" {axis}."
    )
    return Picture(
        name, title, words, svg, Table(("", axis), tuple(zip(labels, values, strict=True)))
    )


def points(
    name: str,
    title: str,
    labels: Sequence[str],
    series: Sequence[PlotSeries],
    axis: str,
    goal: float | None = None,
) -> Picture:
    """Draw points with intervals, one row for each label; a dashed line marks ``goal``.

    The series of a row are drawn one below the other.
    """
    with mpl.rc_context(LOOK):
        figure, axes = _rows(labels, axis)
        for number, each in enumerate(series):
            shown = [k for k, value in enumerate(each.values) if value is not None]
            places = [k + 0.3 * (number - 0.5 * (len(series) - 1)) for k in shown]
            axes.errorbar(
                [float(each.values[k] or 0.0) for k in shown],
                places,
                xerr=[float(each.halves[k] or 0.0) for k in shown] if each.halves else None,
                fmt=each.marker,
                color=each.colour,
                label=each.name,
                capsize=2.5,
                markersize=5,
            )
        if goal is not None:
            axes.axvline(goal, color=INK, linestyle="--", linewidth=1.0)
        legend(figure, len(series), handletextpad=0.2)
        svg = inline(figure, name)
    head = ("", *(column for each in series for column in _columns(each)))
    rows = [
        (label, *(cell for each in series for cell in _cells(each, k)))
        for k, label in enumerate(labels)
    ]
    words = (
        f"{title}: {', '.join(each.name for each in series)} for {', '.join(labels)}. {axis}. The"
        " numbers are in the table."
    )
    return Picture(name, title, words, svg, Table(head, tuple(rows)))


def lines(
    name: str,
    title: str,
    across: Sequence[float],
    series: Sequence[PlotSeries],
    axes_words: tuple[str, str],
) -> Picture:
    """Draw curves over ``across`` with occasional markers; ``axes_words`` are the axis labels."""
    with mpl.rc_context(LOOK):
        figure = Figure(figsize=(WIDTH_INCH, 0.6 * WIDTH_INCH), layout="constrained")
        axes = figure.subplots()
        for each in series:
            heights = [float("nan") if value is None else value for value in each.values]
            axes.plot(
                across,
                heights,
                color=each.colour,
                marker=each.marker,
                markevery=max(1, len(across) // 8),
                markersize=4,
                label=each.name,
            )
        axes.set(xlabel=axes_words[0], ylabel=axes_words[1])
        axes.grid(visible=True)
        legend(figure, len(series), handletextpad=0.4)
        svg = inline(figure, name)
    words = (
        f"{title}: curves of {', '.join(each.name for each in series)}, {axes_words[1]} over"
        f" {axes_words[0]}. The numbers are in the table."
    )
    rows = tuple(
        (f"{place:g}", *(each.values[k] for each in series)) for k, place in enumerate(across)
    )
    return Picture(
        name, title, words, svg, Table((axes_words[0], *(each.name for each in series)), rows)
    )


def _columns(series: PlotSeries) -> tuple[str, ...]:
    return (series.name, "95 % ±") if series.halves else (series.name,)


def _cells(series: PlotSeries, k: int) -> tuple[float | None, ...]:
    return (series.values[k], series.halves[k]) if series.halves else (series.values[k],)


def _rows(labels: Sequence[str], axis: str) -> tuple[Figure, Axes]:
    """Return a figure with one row for each label, the first on top."""
    figure = Figure(
        figsize=(WIDTH_INCH, _MARGIN_INCH + _ROW_INCH * len(labels)), layout="constrained"
    )
    axes = figure.subplots()
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x")
    axes.set_axisbelow(True)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=(1, 2, 2.5, 5, 10), min_n_ticks=3))
    axes.set_xlabel(axis)
    return figure, axes


def legend(figure: Figure, columns: int, **spacing: float) -> None:
    """Draw the legend of a picture above it."""
    figure.legend(loc="outside upper right", ncols=columns, frameon=False, borderpad=0.0, **spacing)


def inline(figure: Figure, name: str) -> Markup:
    """Return the figure as an element of the page.

    It has no prologue, no size of its own, and identifiers that no other picture has.
    """
    stream = io.StringIO()
    figure.savefig(
        stream,
        format="svg",
        transparent=True,
        metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
    )
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = (
        re.sub(r' (?:xmlns(?::xlink)?|width|height|version)="[^"]*"', "", text[: text.index(">")])
        + text[text.index(">") :]
    )
    text = re.sub(r'(\bid="|url\(#|xlink:href="#)', rf"\1{name}-", text).replace(
        "xlink:href", "href"
    )
    for stand_in, variable in _COLOURS.items():
        text = text.replace(stand_in, f"var(--{variable})")
    text = text.replace("<svg", '<svg aria-hidden="true" focusable="false"', 1)
    return Markup(text)  # noqa: S704 - matplotlib escapes the labels
