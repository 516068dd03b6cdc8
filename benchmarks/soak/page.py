# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The section of docs/faults.md about a soak."""

from collections.abc import Sequence

from benchmarks.soak.live import FACTOR
from benchmarks.soak.verdict import DDS_HOURS, HOURS, RATE_HZ, Ran
from benchmarks.trend import Trend
from docs.provenance import measured
from tests.faults.page import machine

HEADING = "Soak"
SECTION = """{measured}
Machine: {machine}; {minutes:.0f} min.

- **Core**: {hours:g} simulated hours of each of three rovers, from input messages through pairing,
  conversion and estimator to outgoing messages.
- **DDS**: {dds_hours:g} simulated hours of three rovers over DDS at {factor:g} times real time,
  each with simulator and estimator.

Both parts run at once with four processors or more, one after the other with fewer. A quantity
grows where Mann and Kendall's test finds a trend at 0.1 % that exceeds the allowed growth
(`benchmarks/trend.py`). Counters may not change after the first fifth.

- Core: {core_ran} simulated hours.
- DDS: {dds_ran} simulated hours, median rate {dds_rate} estimates/s of {rate:g}.
"""
TABLE = """
| what | level | growth over the run [%] | allowed [%] | grows |
|---|---|---|---|---|
"""
WORDS = {
    "memory_mb": "resident memory [MB]",
    "blocks": "blocks of memory that Python holds",
    "set_us": "processor time of a set of messages [us]",
    "abnormal": "observations with an unexpected outcome",
    "not_finite": "updates with a number that is not finite",
    "troubled": "messages lost, out of order or without a partner",
    "estimator_mb": "estimator: resident memory [MB]",
    "simulator_mb": "simulator: resident memory [MB]",
    "rate_hz": "estimates/s",
}


def section(trends: Sequence[Trend], ran: Ran) -> str:
    """Return the section: the length of the run, and a row for each quantity of all rovers."""
    head = SECTION.format(
        measured=measured("soak"),
        machine=machine(),
        minutes=ran.minutes,
        hours=HOURS,
        dds_hours=DDS_HOURS,
        factor=FACTOR,
        core_ran=_listed(ran.core_hours, "g"),
        dds_ran=_listed(ran.dds_hours, ".3g"),
        dds_rate=_listed(ran.dds_rate_hz, ".3g"),
        rate=RATE_HZ,
    )
    short = "".join(f"- **Too short**: {text}.\n" for text in ran.shortfalls())
    quantities: dict[str, list[Trend]] = {}
    for each in trends:
        part, name = each.what.partition(", ")[0], each.what.partition(": ")[2]
        quantities.setdefault(f"{part}: {WORDS.get(name, name)}", []).append(each)
    return (
        head + short + TABLE + "\n".join(_row(name, rovers) for name, rovers in quantities.items())
    )


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
