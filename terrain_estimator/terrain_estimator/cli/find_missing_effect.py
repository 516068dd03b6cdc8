# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect RUN...: find the physical effect that the model of rover and soil lacks.

Writes OUT/finding.json and OUT/report.html and, where it names an effect, OUT/model.pt, a model
that estimates it. Exit codes: 0 for any verdict, 2 for a bad argument or too few readable runs.
For single-wheel measurements see find_missing_effect --wheel-table FILE.csv --help.
"""

import argparse
import random
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.cli import single_wheel
from terrain_estimator.console.arguments import (
    WORKERS,
    add_search_options,
    command_parser,
    refuse_twice,
)
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.discovery.evidence.search import Study
from terrain_estimator.discovery.evidence.verdict import Verdict, read_thresholds
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.proof.proof import Proof, prove, settled
from terrain_estimator.discovery.report.diagnosis import diagnose
from terrain_estimator.discovery.report.finding import Finding, investigate
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.learning.finding_model import check_model, prior_of, write_model
from terrain_estimator.model.model_file import ModelFileError
from terrain_estimator.offline.bag_options import BagOptions, add_options, reading_of
from terrain_estimator.offline.cluster import ClusterError
from terrain_estimator.offline.discovery_runs import (
    FEW,
    Runs,
    Workplace,
    refuse_equal,
    workplace,
)
from terrain_estimator.offline.finding_content import finding_content, finding_sentence
from terrain_estimator.offline.finding_file import FINDING, asked, provenance, write_finding
from terrain_estimator.offline.topic_mapping import TopicError
from terramechanics.presets import load_rover, load_soil

WRONG = 2
FEWEST = 2
ROVER = "mars_rover"
MODEL = "model.pt"


class InputError(ValueError):
    """The arguments or runs do not allow an investigation."""


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Investigate the runs that the command line names; return the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if any(each.partition("=")[0] == "--wheel-table" for each in arguments):
        return single_wheel.main(arguments)
    options = _parser().parse_args(arguments)
    torch.set_num_threads(1)
    try:
        reading = reading_of(options)
        rover = load_rover(options.rover or reading.config.rover or ROVER)
        soil = load_soil(options.soil).for_wheel(rover.wheel_width)
        base = options.model or reading.config.model
        hypotheses = singles(options.library)
        runs, held_out = _divided(options)
        results, names = ResultFolder(options.out), _results(base, options.out)
        results.check(*names)
        if base:
            check_model(base, rover)
        nominal = nominal_of(rover, soil, prior_of(base, rover))
        with (
            workplace(len(runs), options.scheduler, options.workers) as place,
            torch.inference_mode(),
            ProgressReport("find_missing_effect") as report,
        ):
            usable = _read(place, runs, nominal, reading, report)
            unseen = _read(place, held_out, nominal, reading, report, held_out=True).blocks
            refuse_equal([*usable.blocks, *unseen])
            study = Study(nominal, usable.blocks, contributions=usable.contributions)
            finding = investigate(study, hypotheses, read_thresholds(), report.at)
            diagnosis = diagnose(study, hypotheses, finding, report.at)
            report.at(0.97, "held-out runs")
            proof = _proof(finding, nominal, unseen, options.seed, place)
            finding = settled(finding, proof)
        told = {
            "asked": asked(nominal.rover.name, options.soil, options.seed, reading),
            "provenance": provenance(nominal.rover, load_soil(options.soil), [*runs, *held_out]),
        }
        content = finding_content(finding, diagnosis, usable.blocks, unseen, proof) | told
        with results.renewing(*names) as new:
            write_finding(new, content)
            model = write_model(finding, nominal.rover, base, options.out / MODEL, new / MODEL)
    except (ConfigError, ClusterError, InputError, ModelFileError, TopicError, OSError) as error:
        sys.stderr.write(f"find_missing_effect: {error}\n")
        return WRONG
    unproven = (
        " (unproven: no run was held out)" if isinstance(model, Path) and proof is None else ""
    )
    sys.stdout.write(
        "\n".join(
            [
                finding_sentence(finding, diagnosis, proof),
                *(str(options.out / name) for name in FINDING),
                f"{model}{unproven}",
            ]
        )
        + "\n"
    )
    return 0


def _results(base: str, out: Path) -> tuple[str, ...]:
    """Return the names of the files to write: not the model's where that is the one to extend."""
    extended = base and Path(base).resolve() == (out / MODEL).resolve()
    return FINDING if extended else (*FINDING, MODEL, "model.json")


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("find_missing_effect", __doc__)
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="bags of drives, at least two"
    )
    parser.add_argument(
        "--hold-out",
        nargs="+",
        type=Path,
        default=[],
        metavar="RUN",
        help="bags for the proof only (default: one in four of three or more runs, at least one)",
    )
    parser.add_argument(
        "--rover",
        default="",
        help=f"name of a rover or path of a rover file (default: parameter rover, else {ROVER})",
    )
    parser.add_argument(
        "--model",
        default="",
        help="name or file of the model to extend (default: parameter model, else the rover's)",
    )
    add_search_options(parser, "all that a planar rover shows", "held-out choice")
    add_options(parser)
    _add_processes(parser)
    return parser


def _add_processes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scheduler",
        default="",
        help="address of a dask.distributed scheduler for the work (default: this machine)",
    )
    parser.add_argument(
        "--workers",
        type=WORKERS,
        default=0,
        help=f"processes on this machine; 0: only this one, or one for each CPU above {FEW} runs",
    )


def _divided(options: argparse.Namespace) -> tuple[list[Path], list[Path]]:
    """Divide the runs into those to search and those for the proof."""
    runs = list(options.runs)
    refuse_twice(
        [*runs, *options.hold_out],
        "every run counts once, either for the search or for the proof (--hold-out)",
    )
    if len(runs) < FEWEST:
        raise InputError(
            f"{len(runs)} run given, at least {FEWEST} are needed: an effect must show in more than"
            " one drive"
        )
    if options.hold_out:
        return runs, list(options.hold_out)
    # With two runs both are needed for the search, and the finding stays unproven.
    count = max(len(runs) // 4, 1) if len(runs) > FEWEST else 0
    # a reproducible choice, no secret
    held_out = set(random.Random(options.seed).sample(range(len(runs)), count))  # noqa: S311
    return [run for k, run in enumerate(runs) if k not in held_out], [
        run for k, run in enumerate(runs) if k in held_out
    ]


def _read(
    place: Workplace,
    bags: Sequence[Path],
    nominal: Nominal,
    reading: BagOptions,
    report: ProgressReport,
    *,
    held_out: bool = False,
) -> Runs:
    """Read all runs; report and leave out those that are unusable, or too short to be held out."""
    found = place.read(
        bags,
        nominal,
        reading,
        lambda share, note: report.at(_READING * share, note),
        held_out=held_out,
    )
    for reason in found.left_out:
        sys.stderr.write(f"find_missing_effect: {reason}\n")
    if len(found.blocks) < FEWEST and not held_out:
        raise InputError(
            f"{len(found.blocks)} of {len(bags)} runs can be used, at least {FEWEST} are needed"
        )
    return found


_READING = 0.03
"""[1] Approximate share of the time that reading takes."""


def _proof(
    finding: Finding, nominal: Nominal, unseen: Sequence[Blocks], seed: int, place: Workplace
) -> Proof | None:
    """Prove the best name on held-out runs, or score the nominal model alone where none is named.

    None where no run is held out.
    """
    named = finding.judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
    return (
        prove(nominal, finding.best if named else None, unseen, seed, place.spread)
        if unseen
        else None
    )


if __name__ == "__main__":
    sys.exit(main())
