# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge the contact law on wheels that laboratories measured, beside a formula and polynomials.

Called by ``make measured``; writes a JSON file and a page.
"""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

import torch

from docs.provenance import measured
from studies.command import refuse, study_parser
from studies.measured.cases import CASES
from studies.measured.study import CaseResult, WheelResult, held_out_wheels, study
from studies.measured.table import MeasuredRun, page
from studies.measured.worlds import WORLDS, World, world
from studies.records import write_results
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 2 a file cannot be read or written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    cases: list[CaseResult] = []
    wheels: list[WheelResult] = []
    worlds: list[World] = []
    pieces = len(CASES) + len(WORLDS)
    try:
        with ProgressReport("studies.measured") as report:
            for case in CASES:
                report.at(len(cases) / pieces, case.title)
                cases.append(study(case, args.seed))
                if case.reference:
                    wheels += held_out_wheels(case, cases[-1])
            for each in WORLDS:
                report.at((len(cases) + len(worlds)) / pieces, each.name)
                worlds.append(world(each, args.tables, args.seed))
        run = MeasuredRun(measured("measured"), args.seed, cases, wheels, worlds)
        text = json.dumps(asdict(run), indent=1) + "\n"
        write_results({args.out: text, args.table: page(run)})
    except OSError as error:
        return refuse("measured", error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(cases)} cases\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("measured", __doc__)
    parser.add_argument(
        "--tables", type=COUNT, default=20, help="simulated ones of each kind, for the coverage"
    )
    parser.add_argument("--seed", type=SEED, default=0, help="of all that is drawn")
    parser.add_argument(
        "--out", type=Path, default=Path("out/measured.json"), help="file of all figures"
    )
    parser.add_argument(
        "--table", type=Path, default=Path("docs/measured.md"), help="page of the tables"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
