# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Report of find_missing_effect: one page from the content of finding.json.

Missing parts are reported as absent.
"""

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.pages import finding_words as say
from terrain_estimator.pages.opening import excluded, signal_words
from terrain_estimator.pages.page import page
from terrain_estimator.pages.pictures import (
    AFTER,
    BEFORE,
    INK,
    Picture,
    PlotSeries,
    Table,
    bars,
    lines,
    points,
)

LISTED = 1e-3
"""[1] Probability from which a candidate has a line of its own."""
MOST = 12
"""Number of disagreements that are listed; more are repetitive."""
ALIKE_NATS = 3.0
"""[nat] Evidence below which two effects cannot be separated: odds of twenty to one."""
_CLEAR_NATS = 3000.0
"""[nat] Evidence from which the colour of a cell no longer changes."""

EVERYWHERE = "everywhere"
"""Name of the region that includes all others."""
STYLES = {"before": (BEFORE, "s"), "after": (AFTER, "o")}
_STRENGTHS = (
    ("cohesion_pa", "Cohesion c", "c [kPa]", 1e-3),
    ("tan_phi", "Friction angle, as tan phi", "tan phi [1]", 1.0),
)
"""Key, title, axis and factor to the unit of the axis."""
_KINDS = {
    "one_step": "Prediction of the next second",
    "rollout": "Simulation of 5 s from the wheel rates alone",
}

Finding = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Unsealed:
    """The hidden truth of simulated runs, revealed only after the verdict."""

    sentence: str
    strengths: Mapping[str, Mapping[str, float]]  # cohesion_pa and tan_phi by the name of the run


def finding_page(finding: Finding, unsealed: Unsealed | None = None) -> str:
    """Return the page about one finding (the content of finding.json).

    ``unsealed`` is the hidden truth, where it is known.
    """
    listed, rest = candidates(finding)
    return page(
        "finding.html",
        verdict=say.verdict(finding),
        unsealed=unsealed,
        asked=_asked(finding),
        where=_where(finding.get("where") or ()),
        soils=finding.get("soils") or finding.get("refuted_soils") or (),
        as_told=not finding.get("soils"),
        rover_constants=[
            {**each, "sentence": say.sentence(say.constant_words(each).removeprefix("rover: "))}
            for each in finding.get("rover_constants") or ()
        ],
        soil_proof=say.sentence((finding.get("soil_proof") or {}).get("sentence", "")),
        soil_refuted=say.soil_refuted(finding),
        candidates=listed,
        rest=rest,
        excluded=excluded(finding["probabilities"]),
        effects=finding["effects"],
        effects_title=effects_title(finding),
        proof=_proof(finding),
        parameters=_parameters(finding, unsealed),
        parameters_words=_PARAMETERS_WORDS,
        apart=_apart(finding.get("isolability") or {}),
        next=_next(finding),
        provenance=_provenance(finding.get("provenance") or {}),
        everything=json.dumps(finding, indent=1, ensure_ascii=False),
    )


_PARAMETERS_WORDS = (
    "If an effect is missing, cohesion and friction angle shift to compensate for it. These are the"
    " estimates of every run without and with what was found."
)


def effects_title(finding: Finding) -> str:
    """Return the title above the sizes of effects."""
    named = finding["verdict"] in {"named", "confusable"}
    return (
        "Sizes of the named effects" if named else "Closest effects, which do not explain the data"
    )


def _asked(finding: Finding) -> dict[str, Any]:
    unsaid = {"rover": "", "soil": "", "other_soils": []}
    told = unsaid | dict(finding.get("asked") or {})
    return told | {
        "runs": finding["runs"],
        "held_out": finding["held_out"],
        "library": library(finding),
        "damaged": finding.get("damaged") or {},
        "left_out": finding.get("left_out") or [],
    }


def library(finding: Finding) -> list[str]:
    """Return the effects that were considered."""
    return [
        name
        for name in finding["probabilities"]
        if name not in {"none", "unknown", "soil"} and " + " not in name
    ]


def candidates(finding: Finding) -> tuple[list[dict[str, Any]], list[str]]:
    """Return candidates worth a line, the most probable first, and the names of the others."""
    ranked = sorted(finding["probabilities"].items(), key=lambda pair: -pair[1])
    listed = [
        {
            "name": name,
            "id": name.replace(" + ", "-"),
            "probability": value,
            "sentence": say.what_it_is(name),
        }
        for name, value in ranked
        if value >= LISTED
    ]
    return listed, [name for name, value in ranked if value < LISTED]


def _where(entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the disagreements in sentences, with one picture for each unit."""
    shown = [
        {**each, "number": k, "sentence": say.disagreement(each)}
        for k, each in enumerate(entries[:MOST], start=1)
    ]
    by_unit: dict[str, list[dict[str, Any]]] = {}
    for each in shown:
        by_unit.setdefault(each["unit"], []).append(each)
    return {
        "sentences": [each["sentence"] for each in shown],
        "pictures": [_where_picture(unit, own) for unit, own in by_unit.items()],
    }


def _where_picture(unit: str, entries: Sequence[Mapping[str, Any]]) -> Picture:
    labels = [f"{each['number']}. {each['row']}: {_place(each)}" for each in entries]
    name = f"disagreement-{entries[0]['number']}"
    rows = tuple(
        (label, each["region"], each["strength"], each["p"])
        for label, each in zip(labels, entries, strict=True)
    )
    drawn = bars(
        name,
        f"How much they disagree, in {unit}",
        labels,
        [each["strength"] for each in entries],
        f"strength [{unit}]",
    )
    return dataclasses.replace(
        drawn, table=Table(("disagreement", "region", f"strength [{unit}]", "p"), rows)
    )


def _place(entry: Mapping[str, Any]) -> str:
    """Return the signal, or the region where the disagreement depends on no signal."""
    return str(entry["region"] if entry["signal"] in {"none", "wheel"} else entry["signal"])


def _proof(finding: Finding) -> dict[str, Any]:
    gap, proof = finding.get("gap") or {}, finding.get("proof") or {}
    scores = proof.get("rows") or ()
    kinds = list(dict.fromkeys(each["kind"] for each in scores))
    overall = {
        kind: [each for each in scores if each["kind"] == kind and each["region"] == EVERYWHERE]
        for kind in kinds
    }
    return {
        "sentence": say.proof_sentence(gap, proof),
        "gap": _gap_table(gap) if gap.get("before") is not None else None,
        "why_not": "the finding has none" if finding["held_out"] else "no run was held out",
        "pictures": [_scores_picture(kind, own) for kind, own in overall.items() if own],
        "tables": [
            (
                _KINDS.get(kind, kind),
                _score_table([each for each in scores if each["kind"] == kind]),
            )
            for kind in kinds
        ],
        "rollouts": [_rollout(each) for each in proof.get("rollouts") or ()],
        "parameters": _halves(proof.get("parameters") or ()),
    }


def _rollout(rollout: Mapping[str, Any]) -> Picture:
    series = [PlotSeries("measured", rollout["measured"], INK, "^")]
    series += [PlotSeries(word, rollout[word], *STYLES[word]) for word in STYLES if rollout[word]]
    said = signal_words(rollout["signal"])
    return lines(
        f"rollout-{rollout['signal']}",
        f"{said.capitalize()} in {rollout['run']}",
        rollout["time_s"],
        series,
        ("time [s]", f"{said} [{rollout['unit']}]"),
    )


def _halves(strengths: Sequence[Mapping[str, Any]]) -> list[Picture]:
    """Return pictures of c and tan phi in the halves of held-out runs.

    The second of a pair is None where no effect was added.
    """
    labels = [f"{each['run']}, {('first', 'second')[each['half']]} half" for each in strengths]
    return [
        points(
            f"held-out-{key}",
            title,
            labels,
            [
                _half_series(strengths, key, unit, k)
                for k in (0, 1)
                if strengths[0][key][k] is not None
            ],
            axis,
        )
        for key, title, axis, unit in _STRENGTHS
        if strengths
    ]


def _half_series(
    strengths: Sequence[Mapping[str, Any]], key: str, unit: float, k: int
) -> PlotSeries:
    word = tuple(STYLES)[k]
    halves = [HALF_WIDTH_95 * unit * each[f"{key}_sd"][k] for each in strengths]
    return PlotSeries(word, [unit * each[key][k] for each in strengths], *STYLES[word], halves)


def _gap_table(gap: Mapping[str, Any]) -> Table:
    closed = gap.get("closed_95") or (None, None)
    rows = (
        ("error before", gap["before"]),
        ("error after", gap["after"]),
        ("noise floor", gap["noise_floor"]),
        ("share of the gap that is closed [1]", gap["closed"]),
        ("its 95 % interval, lower end", closed[0]),
        ("its 95 % interval, upper end", closed[1]),
    )
    return Table(
        ("in standard deviations", "value"), tuple(row for row in rows if row[1] is not None)
    )


def _scores_picture(kind: str, rows: Sequence[Mapping[str, Any]]) -> Picture:
    """Draw errors in units of the noise floor, so that rows of different units share a picture."""
    words = [
        word for k, word in enumerate(STYLES) if any(each["error"][k] is not None for each in rows)
    ]
    series = [
        PlotSeries(word, [_over(each, k) for each in rows], *STYLES[word])
        for k, word in enumerate(words)
    ]
    labels = [each["row"] for each in rows]
    return points(
        f"scores-{kind}",
        _KINDS.get(kind, kind),
        labels,
        series,
        "root mean square error over the noise floor [1]",
        goal=1.0,
    )


def _over(row: Mapping[str, Any], k: int) -> float | None:
    error = row["error"][k]
    return None if error is None else error / row["noise_floor"]


def _score_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    pairs = [
        f"{what} {when}" for what in ("error", "NLL", "coverage") for when in ("before", "after")
    ]
    head = ("row and region", "unit", "noise floor", *pairs)
    return Table(
        head,
        tuple(
            (f"{each['row']}, {each['region']}", each["unit"], each["noise_floor"], *_pairs(each))
            for each in rows
        ),
    )


def _pairs(score: Mapping[str, Any]) -> Iterator[float | None]:
    for what in ("error", "nll", "coverage"):
        yield from score[what]


def _parameters(finding: Finding, unsealed: Unsealed | None) -> list[Picture]:
    """Draw c and tan phi of every searched run before and, where an effect is named, after.

    The truth is added where it is known.
    """
    found, words = (
        finding["parameters"],
        tuple(STYLES) if finding["verdict"] in {"named", "confusable"} else ("before",),
    )
    if len(words) == 1 and unsealed is None:
        return []
    pictures = []
    for key, title, axis, unit in _STRENGTHS:
        series = [
            PlotSeries(word, [unit * each for each in found[word][key]], *STYLES[word])
            for word in words
        ]
        if unsealed is not None:
            series.append(
                PlotSeries(
                    "truth",
                    [unit * unsealed.strengths[run][key] for run in finding["runs"]],
                    INK,
                    "D",
                )
            )
        pictures.append(points(key, title, finding["runs"], series, axis))
    return pictures


def _apart(matrix: Mapping[str, Any]) -> dict[str, Any]:
    """Return the isolability matrix, with its diagonal (an effect over nothing) as a column."""
    names = matrix.get("names") or []
    rows = [
        {
            "name": name,
            "cells": [
                _cell(values[i]),
                *(None if i == j else _cell(value) for j, value in enumerate(values)),
            ],
        }
        for i, (name, values) in enumerate(zip(names, matrix.get("nats") or [], strict=True))
    ]
    return {
        "names": ["nothing", *names],
        "rows": rows,
        "alike": ALIKE_NATS,
        "not_testable": dict(matrix.get("not_testable") or {}),
    }


def _cell(nats: float) -> dict[str, Any]:
    clear = math.log(max(nats, ALIKE_NATS) / ALIKE_NATS) / math.log(_CLEAR_NATS / ALIKE_NATS)
    return {"value": nats, "alike": nats < ALIKE_NATS, "shade": 0.45 * min(clear, 1.0)}


def _next(finding: Finding) -> dict[str, Any]:
    otherwise = (
        "There are no effects to separate."
        if finding["verdict"] in {"none", "soil", "named"}
        else "No drives were compared."
    )
    drives = finding.get("next_drives") or ()
    rows = tuple(
        (each["words"], each["seconds"], " against ".join(each["pair"]), each["nats"])
        for each in drives
    )
    table = (
        Table(("drive", "length [s]", "evidence for", "expected gain [nat]"), rows)
        if rows
        else None
    )
    return {
        "separate_by": say.separation(finding.get("separate_by") or ""),
        "table": table,
        "otherwise": otherwise,
    }


def _provenance(told: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return names with their version or SHA-256."""
    pairs = [(f"{name}, version", value) for name, value in (told.get("versions") or {}).items()]
    pairs += [(f"{name}, SHA-256", value) for name, value in (told.get("sha256") or {}).items()]
    return pairs + [
        (f"run {name}, SHA-256", value) for name, value in told.get("runs_sha256") or ()
    ]
