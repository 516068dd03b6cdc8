# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge the estimator on the drives in ``bags/foreign``, another engine's rover on its own terrain.

Called by ``make foreign``; writes a JSON file and a page. Each drive is kept: a run that ended
early continues where it was.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from functools import partial
from pathlib import Path

import torch

from docs.provenance import digest, measured
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.foreign.drives import Driven, drive, observations_of
from studies.foreign.logs import log_names, measured_columns, read_log
from studies.foreign.models import MODELS, judged_model
from studies.foreign.scores import ModelScore, score
from studies.foreign.table import page
from studies.records import Piece, compute, read_record, write_record, write_results
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.model.loaded import LoadedModel

Place = tuple[str, str, int]
"""Model, log, and the seed of the noise."""


def study_drive(model: LoadedModel, log: str, seed: int) -> Driven:
    """Return what the estimator publishes on a log with the noise of a seed."""
    clean = read_log(log)
    return drive(clean, observations_of(measured_columns(clean, seed), clean.rover), model)


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 no time for every drive; 2 a file cannot be
    read or written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    try:
        with tempfile.TemporaryDirectory() as folder:
            pieces = _pieces(args, Path(folder))
            missing = [piece for piece in pieces.values() if read_record(piece.path) is None]
            # in this process: a loaded model cannot be sent to another
            compute("studies.foreign", missing, 1, args.minutes, _keep)
        scores = _scores(args, pieces)
        if len(scores) < len(MODELS):
            return refuse_too_short("foreign", "drive of every log and model")
        when = measured("foreign")
        figures = {"measured": when, "seed": args.seed, "models": [asdict(each) for each in scores]}
        text = json.dumps(figures, indent=1) + "\n"
        written = page(scores, when, len(args.log), args.draws, args.seed)
        write_results({args.out: text, args.table: written})
    except OSError as error:
        return refuse("foreign", error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(pieces)} drives\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("foreign", __doc__)
    parser.add_argument(
        "--draws", type=COUNT, default=1, help="of the sensors' noise, for each log and model"
    )
    parser.add_argument("--seed", type=SEED, default=0, help="of the first draw")
    parser.add_argument("--log", nargs="+", choices=log_names(), default=log_names(), help="logs")
    add_record_options(parser, "foreign", "drive")
    return parser


def _keep(driven: Driven, path: Path) -> None:
    write_record(asdict(driven), path)


def _pieces(args: argparse.Namespace, folder: Path) -> dict[Place, Piece[Driven]]:
    """Return the drives, all logs with one model first."""
    records = args.records / digest("foreign")
    pieces: dict[Place, Piece[Driven]] = {}
    for name in MODELS:
        model = judged_model(name, folder)
        for seed in range(args.seed, args.seed + args.draws):
            for log in args.log:
                path = records / f"{name}-{log}-{seed}.npz"
                pieces[name, log, seed] = Piece(partial(study_drive, model, log, seed), path)
    return pieces


def _scores(args: argparse.Namespace, pieces: dict[Place, Piece[Driven]]) -> list[ModelScore]:
    """Return the figures of each model whose drives are all done."""
    scores = []
    for name in MODELS:
        own = {place: piece for place, piece in pieces.items() if place[0] == name}
        kept = [read_record(piece.path) for piece in own.values()]
        done = [Driven(**arrays) for arrays in kept if arrays]
        if len(done) == len(own):
            names = [f"{log} {seed}" if args.draws > 1 else log for _, log, seed in own]
            scores.append(score(name, names, done))
    return scores


if __name__ == "__main__":
    sys.exit(main())
