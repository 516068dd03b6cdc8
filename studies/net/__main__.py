# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the contribution of a model's learnt features, with and without hidden effects.

Called by ``make net``; prints a table and writes all figures as JSON.
"""

import argparse
import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import torch

from docs.provenance import measured
from studies.accuracy.scores import PARAMETERS, CellScore, ParameterScore
from studies.command import add_model_option, refuse, study_parser
from studies.limited import Limited
from studies.net.study import PLANTS, Comparison, compare
from studies.records import write_results
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.learning.adding import restored
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import DEFAULT_MODEL, ModelFileError
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.palpaca import PAlpaca
from terramechanics.terrain.soil import Soil

COLUMNS = (
    "plant",
    "",
    "c error, median",
    "tan phi error",
    "coverage of 95 % of c",
    "of tan phi",
    "velocity NLL",
    "change by the net",
    "NIS",
)
HEADER = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|\n"


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 2 the model cannot be read, or a file cannot
    be written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    try:
        loaded = load_model(args.model)
        results = _compared(loaded, args)
        when = measured("net")
        figures = {
            "measured": when,
            "model": loaded.model_id,
            "seed": args.seed,
            "plants": list(map(_figures, results)),
        }
        write_results({args.out: json.dumps(figures, indent=1) + "\n"})
    except (ModelFileError, OSError) as error:
        return refuse("net", error)
    sys.stdout.write(f"{when}\n\n{table(results)}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("net", __doc__)
    add_model_option(parser, f"{DEFAULT_MODEL}_with_net", "name or file of a model with a net")
    parser.add_argument(
        "--soil",
        default="",
        help="name of the soil that is driven on; default: the first of the model's soils",
    )
    parser.add_argument(
        "--plant", nargs="+", choices=PLANTS, default=list(PLANTS), help="plants to drive"
    )
    parser.add_argument("--episodes", type=COUNT, default=200, help="drives of 40 s a plant")
    parser.add_argument(
        "--seed",
        type=SEED,
        default=7_000_000,
        help="of all that is drawn; not the one of any training",
    )
    parser.add_argument(
        "--trust",
        nargs="+",
        type=_probability,
        default=[],
        help="prior probabilities that the net is used; default: the model's",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/net_study.json"), help="file of all figures"
    )
    return parser


def _compared(loaded: LoadedModel, args: argparse.Namespace) -> list[Comparison]:
    """Return the comparisons of all plants."""
    rover, soil = loaded.rover, _soil(loaded, args.soil)
    physics, candidates = restored(loaded, trust=0.0), _candidates(loaded, args.trust)
    results = []
    with ProgressReport(f"studies.net: {loaded.model_id}") as report:
        for index, plant in enumerate(args.plant):
            seed = args.seed + list(PLANTS).index(plant)
            results.append(compare(rover, soil, physics, candidates, plant, args.episodes, seed))
            report.at((index + 1) / len(args.plant), plant)
    return results


def _figures(result: Comparison) -> dict[str, Any]:
    """Return all figures but those of the bound, which a plant with hidden effects has not."""
    figures = dataclasses.asdict(result)
    for score in (
        figures["physics"],
        *(candidate["score"] for candidate in figures["with_net"].values()),
    ):
        for parameter in PARAMETERS:
            for name in ("bound", "ratio_to_bound", "narrowest"):
                del score[parameter][name]
    return figures


def _candidates(loaded: LoadedModel, trusts: list[float]) -> dict[str, PAlpaca]:
    """Return the model with its net, or with the net trusted by each of ``trusts``."""
    named: dict[str, float | None] = {f"net, trusted {trust:g}": trust for trust in trusts}
    return {
        name: restored(loaded, trust=trust) for name, trust in (named or {"and net": None}).items()
    }


def _probability(text: str) -> float:
    value = float(text)
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError(f"{text} is no probability above 0 and below 1")
    return value


def _soil(loaded: LoadedModel, name: str) -> Soil:
    known = {soil.name: soil for soil in loaded.metadata.soils}
    if name and name not in known:
        raise ModelFileError(f"--soil {name}: the model {loaded.model_id} has {', '.join(known)}")
    return known[name] if name else loaded.metadata.soils[0]


def table(results: list[Comparison]) -> str:
    """Return the figures as a Markdown table."""
    lines = []
    for result in results:
        lines.append(f"| {result.plant} | physics | {_line(result.physics)} |")
        lines += [
            f"| | {name} | {_line(found.score, found.nll_change)} |"
            for name, found in result.with_net.items()
        ]
    return HEADER + "\n".join(lines) + "\n"


def _line(score: CellScore, change: Limited | None = None) -> str:
    errors = (
        f"{100.0 * parameter.median_error[-1]:.1f} %"
        for parameter in (score.cohesion, score.tan_phi)
    )
    covered = (_coverage(parameter) for parameter in (score.cohesion, score.tan_phi))
    changed = f"{change.value:+.3f} ({change.low:+.3f} to {change.high:+.3f})" if change else ""
    return " | ".join((*errors, *covered, f"{score.velocity_nll:.3f}", changed, f"{score.nis:.2f}"))


def _coverage(parameter: ParameterScore) -> str:
    covered = parameter.coverage_95
    return f"{100.0 * covered.value:.0f} ({100.0 * covered.low:.0f} to {100.0 * covered.high:.0f})"


if __name__ == "__main__":
    sys.exit(main())
