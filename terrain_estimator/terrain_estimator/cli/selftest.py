# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""selftest: drive a simulated rover for some seconds, and print PASS or FAIL for every output.

The drive goes through estimator, planner, map and recorder. Exit codes: 0 every output passed; 1 an
output failed; 2 wrong arguments, or a process failed.
"""

import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from terrain_estimator.bags import BagError, BagReader
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.demonstration.drive import add_duration, add_pace, random_domain
from terrain_estimator.demonstration.output_checks import OUTPUTS, OutputVerdict, verdicts
from terrain_estimator.demonstration.processes import Fleet, FleetError
from terrain_estimator.topics import Message

# of every input: estimator, planner, recorder and, once these are ready, the watch
READERS = 4
TIMEOUT_S = 120.0
RATE_HZ = 10.0
SIMULATION: dict[str, object] = {
    "soil": "loose_sand",
    "schedule": "S1",
    "seed": 1,
    "wait_for_subscribers": READERS,
    "wait_timeout": TIMEOUT_S,
}


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Run the test; return the exit code."""
    parser = command_parser("selftest", __doc__)
    add_duration(parser, 10.0)
    add_pace(parser, 4.0)
    options = parser.parse_args(arguments)
    domain_id = options.domain_id or random_domain()
    try:
        with tempfile.TemporaryDirectory(prefix="selftest_") as folder:
            bag = drive(Path(folder), domain_id, options.duration, options.real_time_factor)
            found = verdicts(_read(bag), round(options.duration * RATE_HZ))
    except (FleetError, BagError) as error:
        print(f"selftest: {error}", file=sys.stderr)
        return 2
    return report(found)


def drive(folder: Path, domain_id: int, duration_s: float, real_time_factor: float) -> Path:
    """Drive with all nodes and record every output; return the bag.

    Raises FleetError.
    """
    bag = folder / "bag"
    with Fleet(folder / "log", domain_id) as fleet:
        others = [
            fleet.start("terrain_estimator", name)
            for name in ("estimator", "planner", "terrain_map")
        ]
        recorder = fleet.start(
            "terrain_estimator", "recorder", {"output": bag, "topics": " ".join(OUTPUTS)}
        )
        given = SIMULATION | {"duration": duration_s, "real_time_factor": real_time_factor}
        simulator = fleet.start("rover_sim_node", "simulator", given)
        for program, words in zip(
            (*others, recorder),
            ("matched all inputs", "ready", "ready", r"recording \d+"),
            strict=True,
        ):
            fleet.wait_for(program, words, TIMEOUT_S)
        watch = fleet.start("terrain_estimator", "watch")
        fleet.wait_until(
            lambda: not simulator.running,
            "the simulator has driven to the end",
            TIMEOUT_S + 3.0 * duration_s,
        )
        # the recorder last, so that it records the last answers of the others
        for program in (simulator, watch, *others, recorder):
            code = program.stop() if program.running else program.wait(TIMEOUT_S)
            if code != 0:
                raise FleetError(f"{program.name} ended with code {code}:\n{program.last_words}")
    return bag


def _read(bag: Path) -> dict[str, list[Message]]:
    messages = defaultdict(list)
    with BagReader(bag) as reader:
        for raw in reader.messages():
            messages[raw.topic.removeprefix("/")].append(reader.decode(raw))
    return messages


def report(found: list[OutputVerdict]) -> int:
    """Print the verdicts; return the exit code."""
    for verdict in found:
        print(
            f"FAIL  {verdict.output}: {verdict.fault}"
            if verdict.fault
            else f"PASS  {verdict.output}"
        )
    failed = sum(bool(verdict.fault) for verdict in found)
    print(
        f"{failed} of {len(found)} outputs failed" if failed else f"all {len(found)} outputs passed"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
