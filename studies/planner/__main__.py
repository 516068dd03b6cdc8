# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m studies.planner``: drive into random soft patches and count how many rovers the planner saves, and its false stops."""

import argparse
import dataclasses
import itertools
import json
import sys
from pathlib import Path

import torch

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from studies.accuracy.scores import Share
from studies.planner.patches import PatchOutcome, study
from studies.planner.scores import PatchScore, score
from terrain_estimator.config import AdviceConfig
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.model.model_file import ModelFileError, load_model
from terramechanics.terrain.soil import load_soil

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
    """Entry point. 0: measured, whatever the figures are; 2: an argument is wrong, or a file cannot be read or written."""
    torch.set_num_threads(1)
    parser = argparse.ArgumentParser(
        prog="studies.planner",
        description=__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument(
        "--model",
        default="",
        help="name or file of the model; default: the one that the estimator takes",
    )
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
        help="of all that is drawn; of no choice",
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
    args = parser.parse_args(argv)
    try:
        load_soil(args.soil)
        config = configure(AdviceConfig, {"stop_probability": args.stop_probability})
        model = load_model(args.model)
        outcomes: list[PatchOutcome] = []
        count = args.drives * len(args.seed)
        with ProgressReport(f"studies.planner: {count} drives") as report:
            for outcome in itertools.chain.from_iterable(
                study(model, args.soil, args.drives, config, seed) for seed in args.seed
            ):
                outcomes.append(outcome)
                report.at(len(outcomes) / count, "")
        args.out.parent.mkdir(parents=True, exist_ok=True)
        figures = {
            "model": model.model_id,
            "soil": args.soil,
            "seed": args.seed,
            "drives": [dataclasses.asdict(each) for each in outcomes],
        }
        args.out.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    except (ModelFileError, ConfigError, OSError) as error:
        sys.stderr.write(f"studies.planner: {error}\n")
        return 2
    sys.stdout.write(table(outcomes))
    return 0


def table(outcomes: list[PatchOutcome]) -> str:
    """All drives, those that are as the planner's model has it, and those with an effect that it does not know, in Markdown."""
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


def _percent(share: Share | None) -> str:
    return (
        "none"
        if share is None
        else f"{100.0 * share.share:.0f} % ({100.0 * share.low:.0f} to {100.0 * share.high:.0f})"
    )


if __name__ == "__main__":
    sys.exit(main())
