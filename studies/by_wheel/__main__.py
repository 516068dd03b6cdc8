# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""python -m studies.by_wheel prints the tables.

With --planner it prints that of the planner's stops, with --effects those of models with effects,
with --suspensions those of rovers whose loads balances do not determine, with --bounds the
Cramer-Rao bounds of motions on even and uneven ground.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from studies.by_wheel import added
from studies.by_wheel.bound import BOUND_HEAD, MOTION_BOUND_HEAD, bound_lines, motion_bound_lines
from studies.by_wheel.motions import HEAD, HIDDEN, TYPICAL, lines, motions
from studies.by_wheel.stops import STOP_HEAD, stop_lines
from studies.by_wheel.suspensions import SAMPLES, SUSPENSIONS, motions_of
from studies.command import study_parser
from studies.off_plane import KINDS
from studies.tables import table
from tests.turning_hidden import SKID, STEERED


def main(argv: list[str] | None = None) -> int:
    """Print the tables of docs/lateral.md about a model by wheel, or one of docs/planner.md."""
    parser = study_parser("by_wheel", main.__doc__)
    parser.add_argument("--planner", action="store_true", help="what the planner says in turns")
    parser.add_argument(
        "--effects",
        nargs="*",
        choices=added.NAMES,
        help="models with these effects; without a name: with each that a model by wheel can have",
    )
    parser.add_argument(
        "--suspensions", action="store_true", help="rovers whose loads balances do not determine"
    )
    parser.add_argument("--motions", default="", help="only those whose words hold this text")
    parser.add_argument(
        "--bounds", action="store_true", help="what turns can tell on each ground, at best"
    )
    parser.add_argument("--own", action="store_true", help="hide them by the models' own laws")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    if options.effects is not None:
        _effects(options.effects or added.NAMES, own=options.own)
        return 0
    if options.suspensions:
        _suspensions(options.motions)
        return 0
    if options.motions:
        for kind in KINDS:
            asked = [each for each in motions(kind.rover) if options.motions in each.words]
            sys.stdout.write(f"{kind.rover}:\n\n{table(HEAD, lines(kind, asked))}\n")
        return 0
    if options.bounds:
        _bounds()
        return 0
    if options.planner:
        sys.stdout.write(f"{KINDS[0].rover}:\n\n{table(STOP_HEAD, stop_lines())}\n")
        return 0
    for kind in KINDS:
        chosen = motions(kind.rover)
        sys.stdout.write(f"{kind.rover}:\n\n{table(HEAD, lines(kind, chosen))}\n")
        turn = chosen[1 + TYPICAL[kind.rover]]
        hiding = [turn.but(name, hidden=name) for name in HIDDEN]
        sys.stdout.write(f"{kind.rover}, hidden:\n\n{table(HEAD, lines(kind, hiding))}\n")
        sys.stdout.flush()
    sys.stdout.write(f"skid-steer of 60 kg, 60 s:\n\n{table(BOUND_HEAD, bound_lines())}\n")
    return 0


def _effects(names: Sequence[str], *, own: bool) -> None:
    """Print the tables of models with effects, line by line."""
    for turning in (SKID, STEERED):
        sys.stdout.write(f"{turning.rover.name}:\n\n{table(added.HEAD, [])}")
        for line in added.lines(turning, names, own=own):
            sys.stdout.write(f"| {' | '.join(line)} |\n")
            sys.stdout.flush()
        sys.stdout.write("\n")


def _bounds() -> None:
    """Print the tables of the bounds of motions, line by line."""
    for kind in KINDS:
        sys.stdout.write(f"{kind.rover}:\n\n{table(MOTION_BOUND_HEAD, [])}")
        for line in motion_bound_lines(kind):
            sys.stdout.write(f"| {' | '.join(line)} |\n")
            sys.stdout.flush()
        sys.stdout.write("\n")


def _suspensions(words: str) -> None:
    """Print the tables of rovers whose loads balances do not determine, line by line."""
    for kind in SUSPENSIONS:
        asked = [each for each in motions_of(kind) if words in each.words]
        sys.stdout.write(f"{Path(kind.rover).stem}:\n\n{table(HEAD, [])}")
        for line in lines(kind, asked, samples=SAMPLES, compile_core=True):
            sys.stdout.write(f"| {' | '.join(line)} |\n")
            sys.stdout.flush()
        sys.stdout.write("\n")


if __name__ == "__main__":
    sys.exit(main())
