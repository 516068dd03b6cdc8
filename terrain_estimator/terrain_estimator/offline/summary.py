# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Results of a replay as a table for people and as JSON for programs."""

import dataclasses
import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from rover_parameters.parameters import effective
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.estimator.intake import FEWEST
from terrain_estimator.files.atomic import write_file
from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.messaging.messages import Status
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.offline.replay_result import Replay
from terrain_estimator.outcome import Outcome
from terrain_estimator.pages.number_format import finite

WIDTH = 150
"""[characters] Width of the table where stdout is no terminal."""
NARROW = 120
"""[characters] Width of a terminal below which intervals get lines of their own."""
_HEAD = (
    "bag",
    "time",
    "esti|mates",
    "seconds~taken",
    "re|fused",
    "c in kPa~(95 %)",
    "tan phi~(95 %)",
    "status",
    "x real~time",
)
"""Head of the table; "|" and "~" mark where a word or a line may be broken."""
SUSPICIOUS_SHARE = 0.1
"""[1] Share of refused seconds from which the model, not the ground, is suspected."""


def summary(
    replays: Sequence[Replay], model: LoadedModel, config: EstimatorConfig
) -> dict[str, Any]:
    """Return everything about the runs as plain types, with null for NaN, for any JSON reader."""
    return {
        "model_id": model.model_id,
        "model_sha256": model.sha256,
        "configuration": effective(config),
        "bags": [_run_summary(each) for each in replays],
    }


def _run_summary(replay: Replay) -> dict[str, Any]:
    settled = replay.settled
    return {
        "bag": str(replay.bag),
        "estimates_bag": str(replay.estimates_bag),
        "runtime": replay.runtime,
        "configuration_sha256": replay.configuration_sha256,
        "span_s": replay.span_s,
        "missing_s": replay.missing_s,
        "notes": replay.notes,
        "estimates": replay.estimates,
        "used": settled.used,
        "outcomes": {outcome.name: count for outcome, count in sorted(settled.outcomes.items())},
        "waiting": replay.last.update.estimate.observations_waiting if replay.last else 0,
        "seconds_taken": settled.seconds_taken,
        "seconds_refused": settled.seconds_refused,
        "inputs": {
            topic: dataclasses.asdict(counters) for topic, counters in replay.inputs.items()
        },
        "lost": dict(sorted((+replay.sequences.lost).items())),
        "late": dict(sorted((+replay.sequences.late).items())),
        "rates": [
            {"hz": rate.hz, "treatment": rate.treatment.name, "readings": count}
            for rate, count in replay.rates.found()
        ],
        "status": replay.status,
        "status_text": replay.status_text,
        "disagreements": [each.finding for each in replay.disagreements],
        "estimate": estimate_summary(replay),
        "effects": effects_summary(replay),
        "wall_s": replay.wall_s,
        "times_real_time": finite(replay.times_real_time),
        "identical_to_live": (
            None if replay.differences is None else not any(replay.differences.values())
        ),
        "differences": replay.differences,
    }


def estimate_summary(replay: Replay) -> dict[str, Any]:
    """Return the last estimate with the truth, where the bag has it.

    It is empty where nothing was learnt or the model does not fit: a prior is no estimate.
    """
    if replay.last is None or not replay.gave_estimate:
        return {}
    estimate, truth = replay.last.update.estimate, replay.truth
    result = {}
    for index, (name, attribute) in enumerate(
        (("cohesion_pa", "cohesion"), ("tan_phi", "tan_phi"))
    ):
        result[name] = {
            "mean": finite(float(estimate.mean[index])),
            "sd": finite(math.sqrt(float(estimate.covariance[index, index]))),
            "lower_95": finite(float(estimate.lower_95[index])),
            "upper_95": finite(float(estimate.upper_95[index])),
            "identified": bool(estimate.identified[index]),
            "truth": None if truth is None else float(getattr(truth, attribute)),
        }
    return result


def effects_summary(replay: Replay) -> list[dict[str, Any]]:
    """Return the last size of each named effect of the model, in its unit; empty as the estimate.

    The interval is of 95 %.
    """
    if replay.last is None or not replay.gave_estimate:
        return []
    return [
        {
            "name": each.name,
            "mean": finite(each.mean),
            "sd": finite(each.sd),
            "lower_95": finite(each.mean - HALF_WIDTH_95 * each.sd),
            "upper_95": finite(each.mean + HALF_WIDTH_95 * each.sd),
            "unit": each.unit,
        }
        for each in replay.last.update.estimate.effects
    ]


def print_table(replays: Sequence[Replay]) -> None:
    """Print one line for each bag, then what its estimate says beside it, and remarks."""
    console = Console(
        highlight=False,
        markup=False,
        soft_wrap=True,
        color_system=None,
        width=None if sys.stdout.isatty() else WIDTH,
    )
    narrow = console.width < NARROW
    head = [
        (
            each.replace("|", "-\n").replace("~", "\n")
            if narrow
            else each.replace("|", "").replace("~", " ")
        )
        for each in _HEAD
    ]
    table = Table(*head)
    if narrow:
        table.box, table.collapse_padding, table.pad_edge = SIMPLE_HEAD, True, False
        for column in table.columns[1:]:
            column.no_wrap = True
    for each in replays:
        settled = each.settled
        values = estimate_summary(each)
        table.add_row(
            each.name,
            f"{each.span_s:.1f} s",
            str(each.estimates),
            f"{settled.seconds_taken} of {settled.seconds}",
            str(settled.refused),
            _interval(values.get("cohesion_pa"), 1e-3, narrow=narrow),
            _interval(values.get("tan_phi"), 1.0, narrow=narrow),
            each.status,
            f"{each.times_real_time:.0f}",
        )
    console.print(table)
    for each in replays:
        for line in [*_about_the_estimate(each), *remarks(each)]:
            console.print(line)


def write_summary(path: Path, content: dict[str, Any]) -> None:
    """Write JSON atomically: a reader never sees half of it. Raises OutputError."""
    write_file(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def _interval(value: dict[str, Any] | None, scale: float, *, narrow: bool) -> str:
    if not value or value["mean"] is None:
        return "-"
    mean, lower, upper = (value[key] * scale for key in ("mean", "lower_95", "upper_95"))
    truth = "" if value["truth"] is None else f"truth {value['truth'] * scale:.3g}"
    if narrow:
        return f"{mean:.3g}\n{lower:.3g} to {upper:.3g}\n{truth}".rstrip()
    return f"{mean:.3g} ({lower:.3g} to {upper:.3g}{truth and ', '}{truth})"


def _about_the_estimate(replay: Replay) -> Iterator[str]:
    """Yield what the table has no room for; a report has it in its verdict."""
    if replay.gave_estimate and replay.status != Status.IDENTIFIED.name:
        yield f"{replay.name}: {replay.status_text}"
    for each in effects_summary(replay):
        if each["mean"] is not None and each["sd"] is not None:
            unit = "" if each["unit"] in {"", "1"} else f" {each['unit']}"
            yield (
                f"{replay.name}: {each['name']} {each['mean']:.4g}{unit}"
                f" (95 %: {each['lower_95']:.4g} to {each['upper_95']:.4g})"
            )


def remarks(replay: Replay) -> list[str]:
    """Return remarks on a run for the user, one for each line."""
    lines = list(replay.notes)
    if replay.missing_s:
        lines.append(f"{replay.bag}: the last {replay.missing_s:.1f} s are missing")
    lines += [f"{replay.name}: {line}" for line in replay.rates.lines()]
    lines += [f"{replay.name}: {line}" for line in _about_the_fit(replay)]
    return lines + _about_the_inputs(replay)


def _about_the_fit(replay: Replay) -> Iterator[str]:
    settled = replay.settled
    for outcome, count in sorted(settled.outcomes.items()):
        if outcome.advice and (replay.learnt or not replay.estimates):  # else it is said below
            yield f"{count} x {outcome.name}: {outcome.advice}"
    for each in replay.disagreements:
        yield f"NO ESTIMATE, {each.finding}: {each.advice}"
    if replay.estimates and not replay.learnt:
        waiting = replay.last is not None and replay.last.update.estimate.observations_waiting > 0
        short = "the drive ended before its first second" if waiting else Outcome.STANDSTILL.advice
        yield f"NO ESTIMATE, no observation was used: {replay.refusals.words() or short}"
    refused, judged = settled.seconds_refused, settled.seconds >= FEWEST
    if judged and refused > SUSPICIOUS_SHARE * settled.seconds and not replay.disagreements:
        yield (
            f"{refused} of {settled.seconds} seconds of driving were refused: check that the model"
            " (--model) is for this rover and soil"
        )


def _about_the_inputs(replay: Replay) -> list[str]:
    lines = []
    for topic, counters in replay.inputs.items():
        troubles = {
            "unpaired": counters.unpaired,
            "out of order": counters.out_of_order,
            "lost": counters.lost,
        }
        if any(troubles.values()):
            lines.append(
                f"{replay.name}: {topic}:"
                f" {', '.join(f'{count} {what}' for what, count in troubles.items() if count)}"
            )
    lost, late = +replay.sequences.lost, +replay.sequences.late
    for topic in sorted(lost | late):
        counts = [
            f"{count[topic]} {what}"
            for what, count in (("out of order", late), ("lost", lost))
            if count[topic]
        ]
        lines.append(
            f"{replay.name}: {topic}: {', '.join(counts)}, by the sequence numbers in the messages"
        )
    for topic, difference in (replay.differences or {}).items():
        lines.append(
            f"{replay.name}: {topic}"
            f" {f'differs from live: {difference}' if difference else 'is identical to live'}"
        )
    return lines
