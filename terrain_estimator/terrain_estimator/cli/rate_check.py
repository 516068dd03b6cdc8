# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""rate_check: drive in real time on this machine, and check the rates by the receiver's clock.

Exit codes: 0 every 10 Hz topic keeps its rate; 1 a topic does not; 2 wrong arguments, or a
process failed.
"""

import sys
from typing import Any

from rich.console import Console
from rich.table import Table

from terrain_estimator.console.arguments import add_out, command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.demonstration.drive import (
    DriveSettings,
    add_duration,
    add_seed,
    drive,
    random_domain,
    renewing,
)
from terrain_estimator.demonstration.processes import FleetError
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.offline.summary import write_summary
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES

RATE_HZ = 10.0
RATE_TOLERANCE = 0.01
JITTER_LIMIT_MS = 10.0
TOPICS = (*INPUT_TYPES, *OUTPUT_TYPES)


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Run the check; return the exit code."""
    parser = command_parser("rate_check", __doc__)
    add_out(parser, "out/rate_check")
    add_duration(parser, 30.0)
    add_seed(parser)
    options = parser.parse_args(arguments)
    what = DriveSettings(
        options.duration, 1.0, options.seed, "mars_rover", "loose_sand", "S1", random_domain()
    )
    try:
        with renewing(ResultFolder(options.out), "summary.json") as (new, logs):
            timing = drive(what, new, logs, lambda _: None).timing
            failures = [topic for topic in TOPICS if not keeps_its_rate(timing, topic)]
            write_summary(new / "summary.json", timing | {"failed": failures})
    except (FleetError, OSError) as error:
        print(f"rate_check: {error}", file=sys.stderr)
        return 2
    _print_table(timing)
    print(
        f"{'failed: ' + ', '.join(failures) if failures else 'every topic keeps its rate'};"
        f" {options.out / 'summary.json'}"
    )
    return 1 if failures else 0


def keeps_its_rate(timing: dict[str, Any], topic: str) -> bool:
    """Return whether a topic's median rate is within 1 % of 10 Hz, with a jitter below 10 ms.

    The jitter is the 99th percentile.
    """
    rate_hz, jitter_ms = (
        timing["rate_hz"].get(topic, 0.0),
        timing["jitter_ms_p99"].get(topic, float("inf")),
    )
    return bool(abs(rate_hz / RATE_HZ - 1.0) <= RATE_TOLERANCE and jitter_ms < JITTER_LIMIT_MS)


def _print_table(timing: dict[str, Any]) -> None:
    table = Table("topic", "messages", "median rate in Hz", "jitter in ms, 99th percentile")
    for topic in TOPICS:
        rate_hz, jitter_ms = (
            timing["rate_hz"].get(topic, 0.0),
            timing["jitter_ms_p99"].get(topic, float("nan")),
        )
        table.add_row(
            topic, str(timing["messages"].get(topic, 0)), f"{rate_hz:.3f}", f"{jitter_ms:.2f}"
        )
    Console(highlight=False, soft_wrap=True, color_system=None).print(table)


if __name__ == "__main__":
    sys.exit(main())
