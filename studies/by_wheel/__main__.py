# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""python -m studies.by_wheel prints the tables.

With --planner it prints that of the planner's stops, with --effects those of models with effects,
with --suspensions those of rovers whose loads balances do not determine, with --varying those of
ground that differs from place to place, with --bounds the Cramer-Rao bounds of motions on even and
uneven ground.
"""

import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import torch

from studies.by_wheel import added
from studies.by_wheel.bound import BOUND_HEAD, MOTION_BOUND_HEAD, bound_lines, motion_bound_lines
from studies.by_wheel.motions import HEAD, HIDDEN, TYPICAL, lines, motions
from studies.by_wheel.stops import STOP_HEAD, stop_lines
from studies.by_wheel.suspensions import SAMPLES, SUSPENSIONS, motions_of
from studies.by_wheel.varying import HEAD as VARYING_HEAD
from studies.by_wheel.varying import varying_lines
from studies.command import study_parser
from studies.off_plane import KINDS
from studies.tables import table
from tests.turning_hidden import SKID, STEERED

_Table = tuple[str, Sequence[str], Iterable[Sequence[str]]]
"""What it is of, its head, and its lines as they are found."""


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
    parser.add_argument(
        "--bounds", action="store_true", help="what turns can tell on each ground, at best"
    )
    parser.add_argument("--own", action="store_true", help="hide them by the models' own laws")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    found: Iterable[_Table] = ()
    if options.effects is not None:
        names = options.effects or added.NAMES
        found = (
            (turning.rover.name, added.HEAD, added.lines(turning, names, own=options.own))
            for turning in (SKID, STEERED)
        )
    elif options.suspensions:
        found = _suspensions(options.motions)
    elif options.varying:
        found = ((kind.rover, VARYING_HEAD, varying_lines(kind)) for kind in KINDS)
    elif options.bounds:
        found = ((kind.rover, MOTION_BOUND_HEAD, motion_bound_lines(kind)) for kind in KINDS)
    elif options.planner:
        found = [(KINDS[0].rover, STOP_HEAD, stop_lines())]
    else:
        found = _motions(options.motions)
    for words, head, every in found:
        sys.stdout.write(f"{words}:\n\n{table(head, [])}")
        for line in every:
            sys.stdout.write(f"| {' | '.join(line)} |\n")
            sys.stdout.flush()
        sys.stdout.write("\n")
    return 0


def _suspensions(asked: str) -> Iterator[_Table]:
    """Yield the tables of rovers whose loads balances do not determine."""
    for kind in SUSPENSIONS:
        chosen = [each for each in motions_of(kind) if asked in each.words]
        found = lines(kind, chosen, samples=SAMPLES, compile_core=True)
        yield Path(kind.rover).stem, HEAD, found


def _motions(asked: str) -> Iterator[_Table]:
    """Yield the tables of the motions whose words hold ``asked``; of all, where it is empty."""
    for kind in KINDS:
        chosen = [each for each in motions(kind.rover) if asked in each.words]
        yield kind.rover, HEAD, lines(kind, chosen)
        if not asked:
            turn = chosen[1 + TYPICAL[kind.rover]]
            hiding = [turn.but(name, hidden=name) for name in HIDDEN]
            yield f"{kind.rover}, hidden", HEAD, lines(kind, hiding)
    if not asked:
        yield "skid-steer of 60 kg, 60 s", BOUND_HEAD, bound_lines()


if __name__ == "__main__":
    sys.exit(main())
