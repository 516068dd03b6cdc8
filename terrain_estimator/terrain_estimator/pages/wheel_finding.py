# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Report about tables of one wheel: one page from the content of finding.json."""

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from terrain_estimator.pages import finding_words as say
from terrain_estimator.pages.finding import STYLES, Finding, candidates, effects_title, library
from terrain_estimator.pages.page import page
from terrain_estimator.pages.pictures import Picture, PlotSeries, Table, points

_PROVEN = {
    True: "The named effect improves the prediction of settings that were not fitted",
    False: "The closest effect does not improve the prediction of settings that were not fitted",
    None: "These settings are too few for a proof",
}


def wheel_page(finding: Finding) -> str:
    """Return the page about one finding of ``--wheel-table`` (the content of finding.json)."""
    listed, rest = candidates(finding)
    return page(
        "wheel_finding.html",
        verdict=_verdict(finding),
        asked={**finding, **finding["asked"], "library": library(finding)},
        candidates=listed,
        rest=rest,
        effects=finding["effects"],
        effects_title=effects_title(finding),
        proof=_proof(finding["gap"]),
        limits=finding["limits"],
        left_out=finding["left_out"],
        separate_by=say.separation(finding["separate_by"]),
        everything=json.dumps(finding, indent=1, ensure_ascii=False),
    )


def undescribed(deviations: float) -> str:
    """Return the statement about a model whose errors are too large for a true one."""
    return (
        f"the model does not describe these tables: its held-out error is {deviations:.2g}"
        " deviations of repeatability, more than a true model has with these free parameters"
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
    return {"sentence": _sentence(gap), "picture": _picture(rows), "rows": table}


def _sentence(gap: Mapping[str, Any]) -> str:
    floor = "a true model: 1"
    if gap["after"] is None:
        return (
            f"No effect was added; the error on held-out measurements is {gap['before']:.2g}"
            f" deviations of repeatability ({floor})."
        )
    words = f"from {gap['before']:.2g} to {gap['after']:.2g} deviations of repeatability ({floor})"
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
