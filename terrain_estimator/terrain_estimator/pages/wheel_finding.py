# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Report about tables of one wheel: one page from the content of finding.json."""

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from terrain_estimator.pages import finding_words as say
from terrain_estimator.pages.finding import STYLES, Finding, candidates, effects_title, library
from terrain_estimator.pages.opening import excluded
from terrain_estimator.pages.page import page
from terrain_estimator.pages.pictures import INK, Picture, PlotSeries, Table, lines, points
from terrain_estimator.pages.wheel_fits import fit_sentences

_PROVEN = {
    True: "The named effect improves the prediction of settings that were not fitted",
    False: "The closest effect does not improve the prediction of settings that were not fitted",
    None: "These settings are too few for a proof",
}

ONE_LOAD = 1.5
"""[1] Ratio of loads up to which values are drawn as curves over slip."""


def wheel_page(finding: Finding) -> str:
    """Return the page about one finding of ``--wheel-table`` (the content of finding.json)."""
    listed, rest = candidates(finding)
    return page(
        "wheel_finding.html",
        verdict=_verdict(finding),
        asked={"prior_odds": {}, **finding, **finding["asked"], "library": library(finding)},
        candidates=listed,
        rest=rest,
        excluded=excluded(finding["probabilities"]),
        effects=finding["effects"],
        effects_title=effects_title(finding),
        proof=_proof(finding["gap"]),
        fits=fit_sentences(finding["fits"]),
        limits=finding["limits"],
        left_out=finding["left_out"],
        separate_by=say.separation(finding["separate_by"]),
        next=_next(finding),
        everything=json.dumps(finding, indent=1, ensure_ascii=False),
    )


def undescribed(deviations: float) -> str:
    """Return the statement about a model whose errors are too large for a true one."""
    return (
        f"the model does not describe these tables: its held-out error is {deviations:.2g}"
        " deviations of measurement, more than a true model has with these free parameters"
    )


def _verdict(finding: Finding) -> say.Headline:
    """Return the verdict, with the statement that the model does not describe the tables."""
    found, gap = say.verdict(finding), finding["gap"]
    if gap["described"]:
        return found
    misfit = "the model does not describe these tables"
    if found.name == "none":
        headline = f"No effect identified: {misfit}"
    elif gap["proven"]:
        headline = f"{found.headline}; even with that {misfit}"
    else:
        closest = found.headline.removeprefix("The model lacks ")
        headline = "The model does not describe these tables" + (
            f"; it may lack {closest}" if closest != found.headline else ""
        )
    sentence = undescribed(gap["before"] if gap["after"] is None else gap["after"])
    return dataclasses.replace(
        found,
        sign="?",
        headline=headline,
        sentence=found.sentence + f" {sentence[0].upper()}{sentence[1:]}.",
    )


def _proof(gap: Mapping[str, Any]) -> dict[str, Any]:
    rows = gap["rows"]
    head = ("row", "unit", "before", "after", "noise floor")
    table = Table(
        head,
        tuple(
            (name, each["unit"], each["before"], each["after"], each["noise_floor"])
            for name, each in rows.items()
        ),
    )
    drawn = [_drawn(name, gap["points"]) for name in (gap.get("points") or {}).get("rows", ())]
    return {
        "sentence": _sentence(gap),
        "pictures": [*drawn, _picture(rows)],
        "rows": table,
    }


def _drawn(name: str, points_of: Mapping[str, Any]) -> Picture:
    """Draw measured and predicted values of one row at every held-out setting."""
    row, slips, loads = points_of["rows"][name], points_of["slip"], points_of["load_n"]
    order = sorted(range(len(slips)), key=lambda k: (round(loads[k]), slips[k]))
    factor, unit = (1e3, "mm") if row["unit"] == "m" else (1.0, row["unit"])

    def values(word: str) -> list[float | None]:
        return [None if row[word][k] is None else factor * row[word][k] for k in order]

    series = [PlotSeries("measured", values("measured"), INK, "^")]
    series += [PlotSeries(word, values(word), *STYLES[word]) for word in STYLES if row[word]]
    said = name.replace("_", " ")
    title, axis = f"{said.capitalize()} at settings that were held out", f"{said} [{unit}]"
    if max(loads) < ONE_LOAD * min(loads) and len(set(slips)) == len(slips):
        across = [slips[k] for k in order]
        return lines(f"settings-{name}", title, across, series, ("slip [1]", axis))
    labels = [f"slip {slips[k]:.2g}, {loads[k]:.3g} N" for k in order]
    return points(f"settings-{name}", title, labels, series, axis)


def _next(finding: Finding) -> list[str]:
    """Return what to measure next where no two names are to be separated."""
    gap, verdict = finding["gap"], finding["verdict"]
    torque = "torque" in finding["rows"]
    advice = []
    if verdict in {"named", "confusable"} and gap["proven"] is None:
        advice.append(
            "Measure five slips or more with and without what differs: these are too few for a"
            " proof on settings that were not fitted."
        )
    if not torque:
        advice.append("Measure the drive torque: without it c and tan phi are not identified.")
    if verdict in {"named", "confusable"} and not finding["asked"]["reference"]:
        advice.append(
            "Measure a wheel or soil on which the effect cannot act, at the same slips and load,"
            " and give its table with --reference: a difference is surer than a misfit."
        )
    if verdict == "unknown":
        left = finding["left"][0] if finding["left"] else {"row": "sinkage", "signal": "slip"}
        advice.append(
            f"Repeat the settings at which the {left['row'].replace('_', ' ')} misses most, and"
            f" vary {left['signal']} alone: what is missing depends most on it."
        )
    if not gap["described"]:
        advice.append(
            "Press plates as wide as the wheel and shear at the wheel's pressure: errors of the"
            " soil constants look like a wrong law."
        )
    return advice


def _sentence(gap: Mapping[str, Any]) -> str:
    floor = "a true model: 1"
    if gap["after"] is None:
        return (
            f"No effect was added; the error on held-out measurements is {gap['before']:.2g}"
            f" deviations of measurement ({floor})."
        )
    words = f"from {gap['before']:.2g} to {gap['after']:.2g} deviations of measurement ({floor})"
    return f"{_PROVEN[gap['proven']]}: their error changes {words}."


def _picture(rows: Mapping[str, Any]) -> Picture:
    """Draw errors in units of repeatability, so that rows of different units share a picture."""
    words = [word for word in STYLES if any(each[word] is not None for each in rows.values())]
    series = [
        PlotSeries(
            word, [each[word] / each["noise_floor"] for each in rows.values()], *STYLES[word]
        )
        for word in words
    ]
    axis = "root mean square error over the noise floor [1]"
    return points("held-out", "Prediction of held-out settings", list(rows), series, axis, goal=1.0)
