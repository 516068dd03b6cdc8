# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One simulated drive on real DDS, with every node in a process of its own."""

import json
import random
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from terrain_estimator.console.arguments import real
from terrain_estimator.demonstration.processes import Fleet, FleetError, Program
from terrain_estimator.files.results import ResultFolder

START_TIMEOUT_S = 60.0  # importing torch from a cold disk is slow
MATCH_TIMEOUT_S = 20.0
RECORDED = ("bag", "timing.json")
"""Names of the results of a drive."""
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
    _add_positive(parser, "--duration", duration_s, "simulated time [s]")


def _add_positive(parser: ArgumentParser, name: str, default: float, meaning: str) -> None:
    parser.add_argument(
        name,
        type=real(0.0, exclusive=True),
        default=default,
        help=f"{meaning} (default: %(default)s)",
    )


def add_pace(parser: ArgumentParser, factor: float) -> None:
    """Add the options ``--real-time-factor`` and ``--domain-id``."""
    _add_positive(parser, "--real-time-factor", factor, "simulated time over real time")
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
    """Draw a ROS domain that is probably unused."""
    return random.SystemRandom().randint(1, 101)


@contextmanager
def renewing(results: ResultFolder, *names: str) -> Iterator[tuple[Path, Path]]:
    """Yield empty folders for the results of a drive and for its logs; the logs of a failure stay.

    ``names`` are those of the other results.
    """
    with (
        results.renewing(*RECORDED, *names) as new,
        results.renewing("log", despite=FleetError) as logs,
    ):
        try:
            yield new, logs / "log"
        except FleetError as error:
            raise FleetError(str(error).replace(str(logs), str(results.path))) from error


def drive(what: DriveSettings, folder: Path, logs: Path, say: Callable[[str], None]) -> Recording:
    """Drive, estimate and record into an empty folder; pass the watch's lines to ``say``.

    Raises:
        FleetError: a process failed.
    """
    bag, report = (folder / name for name in RECORDED)
    with Fleet(logs, what.domain_id) as fleet:
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
