# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One simulated drive on real DDS, with every node in a process of its own."""

import json
import random
import shutil
from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from terrain_estimator.console.arguments import real
from terrain_estimator.demonstration.processes import Fleet, FleetError, Program

START_TIMEOUT_S = 60.0  # importing torch from a cold disk is slow
MATCH_TIMEOUT_S = 20.0
READERS = 3  # of every input: estimator, recorder and watch


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """Settings of a drive."""

    duration_s: float  # of simulated time
    real_time_factor: float
    seed: int
    rover: str
    soil: str
    schedule: str
    domain_id: int


@dataclass(frozen=True, slots=True)
class Recording:
    """Result of a drive."""

    bag: Path
    timing: dict[str, Any]  # the watch's report: messages, rate_hz, jitter_ms_p99 by topic


def add_duration(parser: ArgumentParser, duration_s: float) -> None:
    """Add the option ``--duration``."""
    parser.add_argument(
        "--duration",
        type=real(0.0, exclusive=True),
        default=duration_s,
        help="simulated time [s] (default: %(default)s)",
    )


def add_pace(parser: ArgumentParser, factor: float) -> None:
    """Add the options ``--real-time-factor`` and ``--domain-id``."""
    parser.add_argument(
        "--real-time-factor",
        type=real(0.0, exclusive=True),
        default=factor,
        help="simulated time over real time (default: %(default)s)",
    )
    parser.add_argument(
        "--domain-id",
        type=int,
        default=0,
        help="ROS domain (default: a random one, so that nothing else is disturbed)",
    )


def add_seed(parser: ArgumentParser) -> None:
    """Add the option ``--seed``."""
    parser.add_argument(
        "--seed", type=int, default=1, help="seed of drive and noise (default: %(default)s)"
    )


def random_domain() -> int:
    """Draw a ROS domain that probably nobody uses."""
    return random.SystemRandom().randint(1, 101)


def drive(what: DriveSettings, folder: Path, say: Callable[[str], None]) -> Recording:
    """Drive, estimate and record into ``folder``; pass the watch's lines to ``say``.

    Raises:
        FleetError: a process failed.
    """
    clear(folder)
    bag, report = folder / "bag", folder / "timing.json"
    with Fleet(folder / "log", what.domain_id) as fleet:
        estimator = fleet.start("terrain_estimator", "estimator")
        recorder = fleet.start("terrain_estimator", "recorder", {"output": bag})
        simulator = fleet.start("rover_sim_node", "simulator", _simulator_parameters(what))
        fleet.wait_for(estimator, r"matched all inputs", START_TIMEOUT_S)
        fleet.wait_for(recorder, r"recording \d+ topics", MATCH_TIMEOUT_S)
        # A publisher that has matched a reader may not be matched by it yet, and its messages are
        # then lost. So the simulator waits for one more reader, the watch, which starts when the
        # two that must miss nothing report that they are ready.
        watch = fleet.start(
            "terrain_estimator",
            "watch",
            {"report": report, "real_time_factor": what.real_time_factor},
        )
        fleet.wait_for(watch, r"matched all topics", START_TIMEOUT_S)
        _follow(
            fleet,
            simulator,
            watch,
            3.0 * what.duration_s / what.real_time_factor + START_TIMEOUT_S,
            say,
        )
        # the estimator first, so that its last answers are recorded
        for program in (estimator, watch, recorder):
            code = program.stop()
            if code != 0:
                raise FleetError(f"{program.name} ended with code {code}, see {program.log}")
    return Recording(bag, json.loads(report.read_text(encoding="utf-8")))


def clear(folder: Path) -> None:
    """Remove the results of an earlier drive."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("bag", "replay", "log"):
        shutil.rmtree(folder / name, ignore_errors=True)


def _simulator_parameters(what: DriveSettings) -> dict[str, object]:
    return {
        "rover": what.rover,
        "soil": what.soil,
        "schedule": what.schedule,
        "seed": what.seed,
        "duration": what.duration_s,
        "real_time_factor": what.real_time_factor,
        "wait_for_subscribers": READERS,
        "wait_timeout": 2.0 * START_TIMEOUT_S,
    }


def _follow(
    fleet: Fleet, simulator: Program, watch: Program, timeout_s: float, say: Callable[[str], None]
) -> None:
    """Pass on the watch's output until the simulator has driven to the end."""
    said = len(watch.output)

    def ended() -> bool:
        nonlocal said
        text = watch.output
        whole = text.rfind("\n") + 1
        for line in text[said:whole].splitlines():
            say(line)
        said = max(said, whole)
        return not simulator.running

    fleet.wait_until(ended, "the simulator has driven to the end", timeout_s)
    code = simulator.wait(timeout_s)
    if code != 0:
        raise FleetError(f"simulator ended with code {code}, see {simulator.log}")
