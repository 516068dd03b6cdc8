# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""demo: drive a simulated rover on ROS 2, estimate its ground, record, replay, compare, draw.

Exit codes: 0 the replay is identical to live; 1 it is not; 2 wrong arguments, or a process failed.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from terrain_estimator.bags import BagError, BagReader
from terrain_estimator.console.arguments import add_out, command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.demonstration.drive import (
    DriveSettings,
    Recording,
    add_duration,
    add_pace,
    add_seed,
    drive,
    random_domain,
    renewing,
)
from terrain_estimator.demonstration.figure import draw, read_curves
from terrain_estimator.demonstration.processes import FleetError, executable
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.offline.summary import write_summary
from terrain_estimator.topics import stamp_ns

DIFFERENT, FAILED = 1, 2
PICTURE, SUMMARY = "estimate.png", "summary.json"


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Run the demo; return the exit code."""
    options = _parser().parse_args(arguments)
    what = DriveSettings(
        duration_s=options.duration,
        real_time_factor=options.real_time_factor,
        seed=options.seed,
        rover=options.rover,
        soil=options.soil,
        schedule=options.schedule,
        domain_id=options.domain_id or random_domain(),
    )
    try:
        return run(what, options.out)
    except (FleetError, BagError, OSError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return FAILED


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("demo", __doc__)
    add_out(parser, "out/demo")
    add_duration(parser, 60.0)
    add_pace(parser, 5.0)
    add_seed(parser)
    parser.add_argument(
        "--rover", default="mars_rover", help="rover preset or file (default: %(default)s)"
    )
    parser.add_argument(
        "--soil", default="loose_sand", help="soil preset or file (default: %(default)s)"
    )
    parser.add_argument("--schedule", default="S1", help="drive: S1 to S4 (default: %(default)s)")
    return parser


def run(what: DriveSettings, folder: Path) -> int:
    """Drive, replay, compare, draw, summarise; FleetError, BagError or OSError on a failure."""
    print(
        f"{what.rover} drives {what.schedule} on {what.soil} for {what.duration_s:g} s,"
        f" {what.real_time_factor:g} times real time",
        flush=True,
    )
    with renewing(ResultFolder(folder), "replay", PICTURE, SUMMARY) as (new, logs):
        recording = drive(what, new, logs, lambda line: print(line, flush=True))
        print(f"replay, in {folder}:", flush=True)
        replayed = _replay(new)
        draw(
            read_curves(recording.bag),
            new / PICTURE,
            f"{what.rover} on {what.soil}, schedule {what.schedule}, seed {what.seed}",
        )
        content = demo_summary(recording, replayed) | {"bag": str(folder / "bag")}
        write_summary(new / SUMMARY, content)
    _print_results(content, folder / PICTURE, folder / SUMMARY)
    return 0 if content["replay"]["identical_to_live"] else DIFFERENT


def _replay(folder: Path) -> dict[str, Any]:
    """Replay the bag in a folder with the installed command, there; return its summary."""
    command = [executable("terrain_estimator", "replay"), "bag", "--out", "replay", "--compare"]
    result = subprocess.run(command, check=False, cwd=folder)  # noqa: S603
    if result.returncode not in (0, DIFFERENT):
        raise FleetError(f"replay ended with code {result.returncode}")
    replayed: dict[str, Any] = json.loads(
        (folder / "replay/summary.json").read_text(encoding="utf-8")
    )["bags"][0]
    return replayed


def demo_summary(recording: Recording, replayed: dict[str, Any]) -> dict[str, Any]:
    """Return the demo's summary; the live estimate is the last one in the bag."""
    with BagReader(recording.bag) as reader:
        stamps = [stamp_ns(reader.decode(raw)) for raw in reader.messages(["/wheel_slip"])]
        messages = {
            name.removeprefix("/"): topic.count for name, topic in sorted(reader.topics.items())
        }
        *_, last = (reader.decode(raw) for raw in reader.messages(["/terrain_estimate"]))
        truths = [reader.decode(raw) for raw in reader.messages(["/ground_truth/terrain"])]
    truth = truths[-1] if truths else None
    return {
        # each stamp ends a step
        "simulated_s": round(len(stamps) * (stamps[-1] - stamps[0]) / (len(stamps) - 1) * 1e-9, 6),
        "messages": messages,
        "rate_hz": recording.timing["rate_hz"],
        "jitter_ms_p99": recording.timing["jitter_ms_p99"],
        "estimate": {
            "cohesion_pa": {
                "mean": last.cohesion,
                "sd": last.cohesion_stddev,
                "truth": truth.cohesion if truth else None,
            },
            "tan_phi": {
                "mean": last.tan_phi,
                "sd": last.tan_phi_stddev,
                "truth": truth.tan_phi if truth else None,
            },
        },
        "replay": {
            name: replayed[name] for name in ("estimates", "identical_to_live", "times_real_time")
        },
    }


def _print_results(content: dict[str, Any], picture: Path, summary: Path) -> None:
    replayed = content["replay"]
    identical = "identical to live" if replayed["identical_to_live"] else "DIFFERENT from live"
    print(
        f"replay:  {replayed['estimates']} estimates, {identical},"
        f" {replayed['times_real_time']:.0f} times real time"
    )
    print(f"bag:     {content['bag']}")
    print(f"picture: {picture}")
    print(f"summary: {summary}")


if __name__ == "__main__":
    sys.exit(main())
