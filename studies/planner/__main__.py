# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drive into random soft patches; count the rovers that the planner saves, and its false stops.

Called by ``make planner``; prints a table and writes all drives as JSON.
"""

import argparse
import dataclasses
import json
import sys
from pathlib import Path

import torch

from docs.provenance import measured
from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from studies.command import add_model_option, refuse, study_parser
from studies.limited import Limited
from studies.planner.patches import PatchOutcome, study
from studies.planner.scores import PatchScore, score
from studies.records import write_results
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import ModelFileError
from terramechanics.presets import load_soil

COLUMNS = (
    "drives",
    "met a patch",
    "stuck without",
    "saved",
    "axles on firm ground",
    "largest slip",
    "false stops",
    "of these too weak",
    "early",
)
HEADER = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|\n"


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 2 an argument is wrong, or a file cannot be
    read or written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    try:
        load_soil(args.soil)
        config = configure(AdviceConfig, {"stop_probability": args.stop_probability})
        model = load(args.model, AUTO).model
        outcomes = _driven(model, config, args)
        when = measured("planner")
        figures = {
            "measured": when,
            "model": model.model_id,
            "soil": args.soil,
            "seed": args.seed,
            "drives": [dataclasses.asdict(each) for each in outcomes],
        }
        write_results({args.out: json.dumps(figures, indent=1) + "\n"})
    except (ModelFileError, ConfigError, OSError) as error:
        return refuse("planner", error)
    sys.stdout.write(f"{when}\n\n{table(outcomes)}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("planner", __doc__)
    add_model_option(parser)
    parser.add_argument(
        "--soil",
        default="loose_sand",
        help="soil of the firm ground and of the patches; c and phi differ",
    )
    parser.add_argument("--drives", type=COUNT, default=60, help="random drives for each seed")
    parser.add_argument(
        "--seed",
        type=SEED,
        nargs="+",
        default=[9_000_000, 9_000_001],
        help="of all that is drawn; not a seed on which parameters were chosen",
    )
    parser.add_argument(
        "--stop-probability",
        type=float,
        default=AdviceConfig().stop_probability,
        help="the planner's parameter",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/planner_study.json"), help="file of all drives"
    )
    return parser


def _driven(
    model: LoadedModel, config: AdviceConfig, args: argparse.Namespace
) -> list[PatchOutcome]:
    """Return the outcomes of all drives of all seeds."""
    outcomes: list[PatchOutcome] = []
    count = args.drives * len(args.seed)
    with ProgressReport(f"studies.planner: {count} drives") as report:
        for seed in args.seed:
            for outcome in study(model, args.soil, args.drives, config, seed):
                outcomes.append(outcome)
                report.at(len(outcomes) / count, "")
    return outcomes


def table(outcomes: list[PatchOutcome]) -> str:
    """Return a Markdown table: all drives, those without a hidden effect, and those with one."""
    kinds = {
        "all": outcomes,
        "no effect": [outcome for outcome in outcomes if not outcome.effect],
        "one effect": [outcome for outcome in outcomes if outcome.effect],
    }
    return HEADER + "".join(
        _line(name, score(chosen))
        for name, chosen in kinds.items()
        if any(outcome.counts for outcome in chosen)
    )


def _line(name: str, result: PatchScore) -> str:
    cells = (
        name,
        str(result.drives),
        str(result.trapped),
        _percent(result.saved),
        f"{result.firm_axles:.1f}",
        f"{result.slip:.2f}",
        _percent(result.false_stops),
        str(result.too_weak),
        str(result.early),
    )
    return f"| {' | '.join(cells)} |\n"


def _percent(share: Limited | None) -> str:
    return (
        "none"
        if share is None
        else f"{100.0 * share.value:.0f} % ({100.0 * share.low:.0f} to {100.0 * share.high:.0f})"
    )


if __name__ == "__main__":
    sys.exit(main())
