# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Report of replay: one page about one or several runs, from the history that replay kept."""

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from terrain_estimator.intervals import OUTSIDE_68, credible_interval
from terrain_estimator.messaging.history import (
    Errors,
    RunHistory,
    UpdateSpan,
    WheelHistory,
    WheelSpan,
)
from terrain_estimator.messaging.pairing import Counters
from terrain_estimator.outcome import Outcome
from terrain_estimator.pages.number_format import interval, number, words
from terrain_estimator.pages.page import page
from terrain_estimator.pages.pictures import AFTER, BEFORE, INK, Picture, PlotSeries, Table
from terrain_estimator.pages.time_pictures import Course, bands, curves, occurrences
from terrain_estimator.update import Estimate

MARKS = 20
"""Largest number of ground changes that are drawn; more would hide the curve."""
COARSE = 50
"""Largest number of points in the curve of errors."""
_QUANTITIES = (
    ("Cohesion c", "c [kPa]", "kPa", 1e-3),
    ("Friction angle, as tan phi", "tan phi [1]", "", 1.0),
)
"""Title, axis, unit, and factor to that unit, in the order of an estimate."""
_SHORT = ("c", "tan phi")
_PRIOR = "There is no estimate: at the end c and tan phi are the prior's."
_PAIR_COLOURS = (AFTER, BEFORE, INK)


@dataclass(frozen=True, slots=True)
class ShownTruth:
    """Ground of a simulated run from one moment on."""

    stamp_ns: int
    values: tuple[float, float]  # c [Pa], tan phi
    ground: str  # its name, with the effects that act


@dataclass(frozen=True, slots=True)
class ReplayedRun:
    """One replayed bag."""

    name: str
    bag: str
    bag_sha256: str
    state_sha256: str  # of the saved state at the start; empty: the run started from the prior
    span_s: float
    status: str
    status_text: str
    disagreements: Sequence[str]  # why the model does not fit at the end
    remarks: Sequence[str]
    history: RunHistory
    slip: WheelHistory  # [1]
    sinkage: WheelHistory  # [m]
    truths: Sequence[ShownTruth]
    inputs: Mapping[str, Counters]


@dataclass(frozen=True, slots=True)
class Origin:
    """Basis of the estimates of all runs, apart from the bags."""

    rover: str
    identity: Sequence[tuple[str, str]]  # names with their version or SHA-256
    parameters: Sequence[tuple[str, str, str, str]]  # name, value, default and meaning
    citations: Sequence[str]


def run_page(runs: Sequence[ReplayedRun], origin: Origin) -> str:
    """Return the page about these runs."""
    title = f"Run report: {runs[0].name}" if len(runs) == 1 else f"Run report: {len(runs)} runs"
    changed = [name for name, value, default, _ in origin.parameters if value != default]
    shown = [_shown(f"run-{k}", run) for k, run in enumerate(runs, start=1)]
    return page("run.html", title=title, runs=shown, origin=origin, changed=changed)


def _shown(key: str, run: ReplayedRun) -> dict[str, Any]:
    spans = run.history.spans
    told = {
        "key": key,
        "run": run,
        "inputs": _inputs(run.inputs),
        "remarks": run.remarks,
        "ground": _ground(run.truths),
    }
    if not spans:
        return told | {
            "sign": "?",
            "headline": "No estimate from this bag",
            "sentence": "",
            "pictures": [],
        }
    last, truths = spans[-1], _truths(run)
    whole = sum(spans[1:], start=spans[0])
    settled = run.history.settled
    sign, headline = _headline(last.estimate, run.disagreements)
    return told | {
        "sign": sign,
        "headline": headline,
        "sentence": _PRIOR if run.disagreements else _sentence(last.estimate, truths[-1]),
        "pictures": _strengths(key, run, truths),
        "estimates": None if run.disagreements else _estimates(last.estimate, truths[-1]),
        "soils": None if run.disagreements else _soils(last.estimate),
        "fit": _fit(last.estimate),
        "effects": () if run.disagreements else last.estimate.effects,
        "wheels": [
            _wheels(f"{key}-slip", "Slip of the wheels", run, run.slip, "slip [1]", 1.0),
            _wheels(
                f"{key}-sinkage", "Sinkage of the wheels", run, run.sinkage, "sinkage [mm]", 1e3
            ),
        ],
        "prediction": _prediction(key, run),
        "errors": _errors(whole),
        "change": _change(key, run),
        "marked": len(run.truths) > 1,
        "when": _when(key, run),
        "outcomes": _outcomes(whole),
        "used": settled.used,
        "total": whole.count,
        "taken": settled.seconds_taken,
        "seconds": settled.seconds,
    }


def _headline(estimate: Estimate, disagreements: Sequence[str]) -> tuple[str, str]:
    if disagreements:
        finding = "; ".join(disagreements)
        return "✕", f"{finding[:1].upper()}{finding[1:]}"
    known = [
        name for name, identified in zip(_SHORT, estimate.identified, strict=True) if identified
    ]
    unknown = [name for name in _SHORT if name not in known]
    if not known:
        return "?", "Neither c nor tan phi is identified"
    return (
        ("≈", f"{words(known)} is identified, {words(unknown)} is not")
        if unknown
        else ("✓", "c and tan phi are identified")
    )


def _sentence(estimate: Estimate, truth: tuple[float, float]) -> Markup:
    sizes = [
        interval(
            scale * float(estimate.mean[k]),
            scale * _sd(estimate, k),
            unit,
            (scale * float(estimate.lower_95[k]), scale * float(estimate.upper_95[k])),
        )
        for k, (_, _, unit, scale) in enumerate(_QUANTITIES)
    ]
    angle = math.degrees(math.atan(float(estimate.mean[1])))
    sentence = Markup("At the end c is {} and tan phi {}, a friction angle of {}°.").format(
        *sizes, number(angle, "", 3)
    )
    if math.isfinite(truth[0]):
        off = [abs(float(estimate.mean[k]) - truth[k]) / _sd(estimate, k) for k in (0, 1)]
        sentence += Markup(
            " The true ground there has {} and {}: the estimates are {} and {} deviations off."
        ).format(
            number(1e-3 * truth[0], "kPa"),
            number(truth[1]),
            number(off[0], "", 2),
            number(off[1], "", 2),
        )
    return sentence


def _sd(estimate: Estimate, k: int) -> float:
    return math.sqrt(float(estimate.covariance[k, k]))


def _truths(run: ReplayedRun) -> list[tuple[float, float]]:
    """Return the true c [Pa] and tan phi at the end of each span; NaN where they are unknown."""
    stamps = [truth.stamp_ns for truth in run.truths]
    places = [bisect_right(stamps, span.stamp_ns) for span in run.history.spans]
    return [run.truths[place - 1].values if place else (math.nan, math.nan) for place in places]


def _ground(truths: Sequence[ShownTruth]) -> str:
    return words(list(dict.fromkeys(truth.ground for truth in truths)), "then")


def _times(run: ReplayedRun, spans: Sequence[UpdateSpan] | Sequence[WheelSpan] = ()) -> list[float]:
    """Return the ends [s] of the spans, from the first observation."""
    return [(span.stamp_ns - run.history.first_ns) * 1e-9 for span in spans or run.history.spans]


def _strengths(key: str, run: ReplayedRun, truths: Sequence[tuple[float, float]]) -> list[Picture]:
    time_s = _times(run)
    return [
        bands(
            f"{key}-{('cohesion', 'tan-phi')[k]}",
            title,
            _course(run.history.spans, [scale * true[k] for true in truths], time_s, k, scale),
            axis,
        )
        for k, (title, axis, _, scale) in enumerate(_QUANTITIES)
    ]


def _course(
    spans: Sequence[UpdateSpan], truth: list[float], time_s: list[float], k: int, scale: float
) -> Course:
    estimates = [span.estimate for span in spans]
    means, sds = (
        [scale * float(each.mean[k]) for each in estimates],
        [scale * _sd(each, k) for each in estimates],
    )
    low, high = credible_interval(means, sds, OUTSIDE_68)
    return Course(
        time_s,
        means,
        (low.tolist(), high.tolist()),
        (
            [scale * float(each.lower_95[k]) for each in estimates],
            [scale * float(each.upper_95[k]) for each in estimates],
        ),
        truth,
        [span.disagrees for span in spans],
    )


def _estimates(estimate: Estimate, truth: tuple[float, float]) -> Table:
    head = (
        "at the end",
        "estimate",
        "deviation",
        "95 % from",
        "to",
        "identified",
        "truth",
        "error [%]",
    )
    rows = []
    for k, (_, axis, _, scale) in enumerate(_QUANTITIES):
        mean, low, high = (
            scale * float(values[k])
            for values in (estimate.mean, estimate.lower_95, estimate.upper_95)
        )
        true = scale * truth[k] if math.isfinite(truth[k]) else None
        error = None if not true else 100.0 * (mean - true) / true
        rows.append(
            (
                axis,
                mean,
                scale * _sd(estimate, k),
                low,
                high,
                "yes" if estimate.identified[k] else "no",
                true,
                error,
            )
        )
    return Table(head, tuple(rows))


def _fit(estimate: Estimate) -> Table | None:
    rows = tuple((each.row, each.offset, each.spread) for each in estimate.fit)
    return Table(("row", "offset [1]", "spread [1]"), rows) if rows else None


def _soils(estimate: Estimate) -> Table | None:
    ranked = sorted(
        zip(estimate.soils, estimate.soil_probability, strict=True), key=lambda pair: -pair[1]
    )
    return (
        Table(("soil in the model", "probability [1]"), tuple(ranked)) if len(ranked) > 1 else None
    )


def _wheels(
    name: str, title: str, run: ReplayedRun, history: WheelHistory, axis: str, scale: float
) -> Picture:
    """Draw means over short times: a colour for each pair of wheels, dashes for its second."""
    spans = history.spans
    series = [
        PlotSeries(
            wheel.replace("_", " "),
            [_scaled(scale, span.mean(wheel)) for span in spans],
            _PAIR_COLOURS[k // 2 % len(_PAIR_COLOURS)],
            "",
            dash=("-", "--")[k % 2],
        )
        for k, wheel in enumerate(history.wheels)
    ]
    return curves(name, title, _times(run, spans), series, axis)


def _prediction(key: str, run: ReplayedRun) -> Picture:
    coarse = _coarse(run.history.spans)
    errors = [span.errors for span in coarse]
    series = [
        PlotSeries("error", [_millimetres(each.rms) for each in errors], BEFORE, ""),
        PlotSeries("predicted", [_millimetres(each.predicted_rms) for each in errors], AFTER, ""),
    ]
    return curves(
        f"{key}-prediction",
        "Error of the velocity's prediction",
        _times(run, coarse),
        series,
        "root mean square [mm/s]",
    )


def _coarse(spans: Sequence[UpdateSpan]) -> list[UpdateSpan]:
    """Merge spans, so that a mean square is one of many errors."""
    length = math.ceil(len(spans) / COARSE)
    return [sum(spans[k + 1 : k + length], start=spans[k]) for k in range(0, len(spans), length)]


def _millimetres(value: float) -> float | None:
    return _scaled(1e3, value)


def _scaled(scale: float, value: float) -> float | None:
    return scale * value if math.isfinite(value) else None


def _errors(whole: UpdateSpan) -> Table:
    errors: Errors = whole.errors
    share = [
        count / errors.count if errors.count else None
        for count in (errors.inside_68, errors.inside_95)
    ]
    rows = (
        ("predictions compared with a measurement", errors.count),
        ("root mean square error [mm/s]", _millimetres(errors.rms)),
        ("root mean square error, as predicted [mm/s]", _millimetres(errors.predicted_rms)),
        ("share inside the 68 % interval [1]", share[0]),
        ("share inside the 95 % interval [1]", share[1]),
        (
            "normalised innovation squared, near 1 when consistent [1]",
            whole.nis if math.isfinite(whole.nis) else None,
        ),
    )
    return Table(("one step ahead", "value"), rows)


def _change(key: str, run: ReplayedRun) -> Picture:
    series = [
        PlotSeries(
            "probability", [span.change_probability for span in run.history.spans], AFTER, ""
        )
    ]
    marks = [(truth.stamp_ns - run.history.first_ns) * 1e-9 for truth in run.truths[1:]]
    title = "Probability that the ground changed in the last 3 s"
    return curves(
        f"{key}-change",
        title,
        _times(run),
        series,
        "probability [1]",
        marks if len(marks) <= MARKS else (),
        top=1.05,
    )


def _when(key: str, run: ReplayedRun) -> Picture | None:
    """Draw when the outcomes occurred; None where no second has ended yet."""
    happened = sorted({outcome for span in run.history.spans for outcome in span.outcomes})
    counts = {
        outcome.name: [span.outcomes[outcome] for span in run.history.spans] for outcome in happened
    }
    title = "Outcomes of the observations"
    return occurrences(f"{key}-outcomes", title, _times(run), counts) if happened else None


def _outcomes(whole: UpdateSpan) -> list[dict[str, Any]]:
    total = whole.outcomes.total()
    ranked: list[tuple[Outcome, int]] = sorted(whole.outcomes.items())
    return [
        {"name": each.name, "count": count, "share": count / total, "advice": each.advice}
        for each, count in ranked
    ]


def _inputs(inputs: Mapping[str, Counters]) -> Table:
    head = ("topic", "received", "without partner", "out of order", "lost")
    rows = (
        (topic, *(of.received, of.unpaired, of.out_of_order, of.lost))
        for topic, of in inputs.items()
    )
    return Table(head, tuple(rows))
