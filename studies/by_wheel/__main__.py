# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""python -m studies.by_wheel prints the tables.

With --planner it prints that of the planner's stops, with --effects those of models with effects,
with --suspensions those of rovers whose loads balances do not determine, with --varying those of
ground that differs from place to place.
"""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import torch

from studies.by_wheel import added
from studies.by_wheel.bound import BOUND_HEAD, bound_lines
from studies.by_wheel.motions import HEAD, HIDDEN, TYPICAL, lines, motions
from studies.by_wheel.stops import STOP_HEAD, stop_lines
from studies.by_wheel.suspensions import SAMPLES, SUSPENSIONS, motions_of
from studies.by_wheel.varying import HEAD as VARYING_HEAD
from studies.by_wheel.varying import varying_lines
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
    parser.add_argument(
        "--varying", action="store_true", help="ground that differs from place to place"
    )
    parser.add_argument("--motions", default="", help="only those whose words hold this text")
    parser.add_argument("--own", action="store_true", help="hide them by the models' own laws")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    if options.effects is not None:
        names = options.effects or added.NAMES
        for turning in (SKID, STEERED):
            _print(turning.rover.name, added.HEAD, added.lines(turning, names, own=options.own))
        return 0
    if options.suspensions:
        _suspensions(options.motions)
        return 0
    if options.varying:
        for kind in KINDS:
            _print(kind.rover, VARYING_HEAD, varying_lines(kind))
        return 0
    if options.motions:
        for kind in KINDS:
            asked = [each for each in motions(kind.rover) if options.motions in each.words]
            sys.stdout.write(f"{kind.rover}:\n\n{table(HEAD, lines(kind, asked))}\n")
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


def _suspensions(words: str) -> None:
    """Print the tables of rovers whose loads balances do not determine."""
    for kind in SUSPENSIONS:
        asked = [each for each in motions_of(kind) if words in each.words]
        found = lines(kind, asked, samples=SAMPLES, compile_core=True)
        _print(Path(kind.rover).stem, HEAD, found)


def _print(words: str, head: Sequence[str], found: Iterable[Sequence[str]]) -> None:
    """Print a table line by line, as its lines are found."""
    sys.stdout.write(f"{words}:\n\n{table(head, [])}")
    for line in found:
        sys.stdout.write(f"| {' | '.join(line)} |\n")
        sys.stdout.flush()
    sys.stdout.write("\n")


if __name__ == "__main__":
    sys.exit(main())
