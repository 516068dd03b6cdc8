# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect RUN...: which physical effect the model of rover and soil lacks, from recorded runs.

Writes OUT/finding.json and OUT/report.html, and where an effect is named OUT/model.pt, which
estimates it. Exit codes: 0 for any verdict, 2 for a bad argument or too few readable runs.
Single-wheel measurements instead of runs: find_missing_effect --wheel-table FILE.csv --help.
"""

import argparse
import dataclasses
import math
import random
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.cli import single_wheel
from terrain_estimator.console.arguments import SEED, WORKERS, effects, make_folder, refuse_twice
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.discovery import (
    Diagnosis,
    Finding,
    Nominal,
    Proof,
    Study,
    Verdict,
    diagnose,
    investigate,
    nominal_of,
    prove,
    settled,
    singles,
)
from terrain_estimator.discovery.evidence.verdict import read_thresholds
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.proof.gap import Gap
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.learning.finding_model import check_model, prior_of, write_model
from terrain_estimator.model.model_file import ModelFileError
from terrain_estimator.offline.cluster import ClusterError
from terrain_estimator.offline.discovery_runs import FEW, Runs, Workplace, workplace
from terrain_estimator.offline.finding_file import asked, provenance, write_finding
from terrain_estimator.offline.reading import BagOptions, add_options, reading_of
from terrain_estimator.offline.topics import TopicError
from terramechanics.effects import describe
from terramechanics.terrain.soil import load_soil
from terramechanics.vehicle.rover import load_rover

WRONG = 2
FEWEST = 2
ROVER = "mars_rover"


class InputError(ValueError):
    """The arguments or runs do not allow an investigation."""


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Investigate the runs that the command line names; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if any(each.partition("=")[0] == "--wheel-table" for each in arguments):
        return single_wheel.main(arguments)
    options = _parser().parse_args(arguments)
    torch.set_num_threads(1)
    try:
        reading = reading_of(options)
        rover = load_rover(options.rover or reading.config.rover or ROVER)
        soil, base = load_soil(options.soil), options.model or reading.config.model
        hypotheses = singles(options.library)
        runs, held_out = _divided(options)
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
            make_folder("--out", options.out)
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
        written = write_finding(
            options.out, summary(finding, diagnosis, usable.blocks, unseen, proof) | told
        )
        model = write_model(finding, nominal.rover, base, options.out / "model.pt")
    except (ConfigError, ClusterError, InputError, ModelFileError, TopicError, OSError) as error:
        sys.stderr.write(f"find_missing_effect: {error}\n")
        return WRONG
    unproven = (
        " (unproven: no run was held out)" if isinstance(model, Path) and proof is None else ""
    )
    sys.stdout.write(
        "\n".join([sentence(finding, diagnosis, proof), *map(str, written), f"{model}{unproven}"])
        + "\n"
    )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="find_missing_effect",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="bags of drives, at least two"
    )
    parser.add_argument(
        "--hold-out",
        nargs="+",
        type=Path,
        default=[],
        metavar="RUN",
        help="bags for the proof alone (default: one in four of three or more runs, at least one)",
    )
    parser.add_argument(
        "--rover",
        default="",
        help=(
            f"name of a rover or path of a rover file (default: the parameter rover, else {ROVER})"
        ),
    )
    parser.add_argument(
        "--soil",
        default="loose_sand",
        help="name of a soil or path of a soil file (default: %(default)s)",
    )
    parser.add_argument(
        "--library",
        type=effects,
        default=(),
        metavar="NAME,...",
        help="effects to consider (default: all that a planar rover shows)",
    )
    parser.add_argument(
        "--model",
        default="",
        help=(
            "name or file of the model that lacks the effect (default: parameter model, else the"
            " rover's name)"
        ),
    )
    add_options(parser)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/finding"),
        help="folder of the results (default: %(default)s)",
    )
    parser.add_argument(
        "--scheduler",
        default="",
        help="address of a dask.distributed scheduler that takes the work; default: this machine",
    )
    parser.add_argument(
        "--workers",
        type=WORKERS,
        default=0,
        help=(
            f"processes of this machine that take it; 0: this one, above {FEW} runs one for"
            " each CPU"
        ),
    )
    parser.add_argument(
        "--seed", type=SEED, default=0, help="of the choice of held-out runs (default: %(default)s)"
    )
    return parser


def _divided(options: argparse.Namespace) -> tuple[list[Path], list[Path]]:
    """Runs to look into and runs for the proof."""
    runs = list(options.runs)
    refuse_twice(
        [*runs, *options.hold_out],
        "every run counts once, to be searched or by --hold-out for the proof",
    )
    if len(runs) < FEWEST:
        raise InputError(
            f"{len(runs)} run given, at least {FEWEST} are needed: an effect has to show in more"
            " than one drive"
        )
    if options.hold_out:
        return runs, list(options.hold_out)
    # With two runs both are needed to find anything, and what is found stays unproven.
    count = max(len(runs) // 4, 1) if len(runs) > FEWEST else 0
    held_out = set(random.Random(options.seed).sample(range(len(runs)), count))  # noqa: S311 - a reproducible choice, no secret
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
    """All runs; one that cannot be used, or is too short to be held out, is reported and left out."""
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
"""[1] Share of the time that reading takes, about."""


def _proof(
    finding: Finding, nominal: Nominal, unseen: Sequence[Blocks], seed: int, place: Workplace
) -> Proof | None:
    """The best name on held-out runs, where there is one and they are there; else the nominal model alone."""
    named = finding.judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
    return (
        prove(nominal, finding.best if named else None, unseen, seed, place.spread)
        if unseen
        else None
    )


def summary(
    finding: Finding,
    diagnosis: Diagnosis,
    blocks: Sequence[Blocks],
    unseen: Sequence[Blocks],
    proof: Proof | None,
) -> dict[str, Any]:
    """What goes to finding.json."""
    judgement = finding.judgement
    after = judgement.named[0] if judgement.named else None
    return {
        "verdict": str(judgement.verdict),
        "probabilities": judgement.probabilities,
        "effects": [
            entry for hypothesis in judgement.named for entry in _effects(finding, hypothesis)
        ],
        "confusable_with": [each.label for each in judgement.named[1:]],
        "separate_by": diagnosis.separate_by(judgement),
        "left": [
            {
                "row": each.column.row,
                "signal": each.column.signal,
                "strength": math.sqrt(each.strength),
            }
            for each in finding.left[:3]
        ],
        **diagnosis.plain(),
        "added": proof is not None and proof.added,
        **(
            proof.plain()
            if proof
            else {
                "gap": dict.fromkeys(item.name for item in dataclasses.fields(Gap)),
                "proof": None,
            }
        ),
        "parameters": {"before": _parameters(finding, None), "after": _parameters(finding, after)},
        "runs": [each.name for each in blocks],
        "held_out": [each.name for each in unseen],
    }


def _effects(finding: Finding, hypothesis: Hypothesis) -> list[dict[str, Any]]:
    """The effects of one hypothesis with their sizes; of several alternatives each has its own evidence."""
    candidate = finding.candidate(hypothesis)
    factor = candidate.fit.log_evidence - finding.nothing.fit.log_evidence
    probability = finding.judgement.probabilities[" + ".join(hypothesis.names)]
    return [
        {
            "name": name,
            "coefficient": size,
            "sd": sd,
            "unit": describe(name).unit,
            "probability": probability,
            "log_bayes_factor": factor,
        }
        for name, size, sd in candidate.sizes
    ]


def _parameters(finding: Finding, hypothesis: Hypothesis | None) -> dict[str, list[float]]:
    """c [Pa] and tan phi of every run."""
    fit = (finding.candidate(hypothesis) if hypothesis else finding.nothing).fit
    return {
        "cohesion_pa": [1000.0 * float(run.theta[0]) for run in fit.point.runs],
        "tan_phi": [float(run.theta[1]) for run in fit.point.runs],
    }


def sentence(finding: Finding, diagnosis: Diagnosis, proof: Proof | None) -> str:
    """The verdict in words, and what the held-out runs say of it."""
    unproven = "no held-out run: what is found is unproven, give a third run or --hold-out"
    return f"{_verdict(finding, diagnosis)}\n{proof.sentence if proof else unproven}"


def _verdict(finding: Finding, diagnosis: Diagnosis) -> str:
    judgement = finding.judgement
    labels = [each.label for each in judgement.named]
    sizes = ", ".join(
        f"{name} {size:.4g} +- {sd:.2g} {describe(name).unit}"
        for name, size, sd in finding.best.sizes
    )
    left = finding.left[0].column if finding.left else None
    words = {
        "none": "nothing is missing that these runs show",
        "named": f"named: {sizes}",
        "confusable": (
            f"confusable: {', '.join(labels)}. To separate: {diagnosis.separate_by(judgement)}"
        ),
        "unknown": (
            f"unknown: no named effect explains it (closest: {', '.join(labels)})"
            + (f"; the {left.row} row depends on {left.signal}" if left else "")
        ),
    }
    return words[str(judgement.verdict)]


if __name__ == "__main__":
    sys.exit(main())
