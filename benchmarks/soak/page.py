# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The section of docs/faults.md about a soak."""

from collections.abc import Sequence

from benchmarks.soak.live import FACTOR
from benchmarks.soak.verdict import DDS_HOURS, HOURS, RATE_HZ, Ran
from benchmarks.trend import Trend
from tests.faults.page import machine

HEADING = "Soak"
WORDS = {
    "memory_mb": "resident memory [MB]",
    "blocks": "blocks of memory that Python holds",
    "set_us": "processor time of a set of messages [us]",
    "abnormal": "observations with an outcome that nothing calls for",
    "not_finite": "updates with a number that is not finite",
    "troubled": "messages lost, out of order or without a partner",
    "estimator_mb": "estimator: resident memory [MB]",
    "simulator_mb": "simulator: resident memory [MB]",
    "rate_hz": "estimates/s",
}


def section(trends: Sequence[Trend], ran: Ran) -> str:
    """What was run and what came of it; a row for each quantity, with the rovers in turn."""
    lines = [
        (
            f"`make soak`: {HOURS:g} simulated hours of each of three rovers from input messages"
            " through pairing, conversion and estimator to"
        ),
        (
            f"outgoing messages, and {DDS_HOURS:g} simulated hours of three rovers over DDS,"
            f" simulator and estimator each, at {FACTOR:g} times"
        ),
        (
            "real time: at once with four processors or more, one after the other with fewer."
            " Something grows where Mann and Kendall's test"
        ),
        (
            "finds a trend at 0.1 % that amounts to more than is allowed (`benchmarks/trend.py`);"
            " counters may not move after the first fifth."
        ),
        f"{machine()}, {ran.minutes:.0f} min.",
        "",
        (
            f"- Core: {_listed(ran.core_hours, 'g')} simulated hours. DDS:"
            f" {_listed(ran.dds_hours, '.3g')} simulated hours, median rate"
        ),
        f"  {_listed(ran.dds_rate_hz, '.3g')} estimates/s of {RATE_HZ:g}.",
        *(f"- **Too short**: {text}." for text in ran.shortfalls()),
        "",
        "| what | level | growth over the run [%] | allowed [%] | grows |",
        "|---|---|---|---|---|",
    ]
    quantities: dict[str, list[Trend]] = {}
    for each in trends:
        part, name = each.what.partition(", ")[0], each.what.partition(": ")[2]
        quantities.setdefault(f"{part}: {WORDS.get(name, name)}", []).append(each)
    return "\n".join([*lines, *(_row(name, rovers) for name, rovers in quantities.items())])


def _row(name: str, rovers: Sequence[Trend]) -> str:
    counts, grows = not rovers[0].allowed, any(each.grows for each in rovers)
    growth = _listed([each.growth if counts else 100.0 * each.growth for each in rovers], ".2g")
    allowed = "none (a count)" if counts else f"{100.0 * rovers[0].allowed:g}"
    return (
        f"| {name} | {_listed([each.level for each in rovers], '.4g')} | {growth} | {allowed} |"
        f" {'**yes**' if grows else 'no'} |"
    )


def _listed(values: Sequence[float], form: str) -> str:
    return ", ".join(format(value, form) for value in values)
