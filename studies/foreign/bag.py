# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Turn a log of ``bags/foreign`` into a bag: a noisy copy, its mapping, and csv_to_bag.

Called by ``make foreign-bag``.
"""

import subprocess
import sys
from pathlib import Path

from studies.command import refuse, study_parser
from studies.foreign.logs import SINKAGES, STRAIGHT, TURNS, log_names, read_log, write_measured
from terrain_estimator.console.arguments import SEED
from terrain_estimator.console.interrupting import interruptible


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Write measured.csv, measured.yaml and bag to a folder; exit codes as of csv_to_bag."""
    parser = study_parser("foreign.bag", __doc__)
    names = log_names(STRAIGHT) + log_names(TURNS)
    parser.add_argument("log", choices=names, metavar="LOG", help=", ".join(names))
    parser.add_argument("--out", type=Path, required=True, help="folder of the three results")
    parser.add_argument("--seed", type=SEED, default=0, help="of the sensors' noise")
    parser.add_argument("--sinkage", choices=SINKAGES, default="original", help="kind of sinkage")
    args = parser.parse_args(argv)
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        log = read_log(args.log)
        data, mapping = write_measured(log, args.out / "measured", args.seed, args.sinkage)
    except OSError as error:
        return refuse("foreign.bag", error)
    # as a user calls it: studies do not import commands
    command = [sys.executable, "-m", "terrain_estimator.cli.csv_to_bag", str(data)]
    command += ["--mapping", str(mapping), "--out", str(args.out / "bag")]
    command += ["--rover", log.rover.name]
    return subprocess.run(command, check=False).returncode  # noqa: S603


if __name__ == "__main__":
    sys.exit(main())
