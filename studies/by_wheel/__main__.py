# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""python -m studies.by_wheel prints the tables."""

import sys

import torch

from studies.by_wheel.bound import BOUND_HEAD, bound_lines
from studies.by_wheel.motions import HEAD, HIDDEN, TYPICAL, lines, motions
from studies.command import study_parser
from studies.off_plane import KINDS
from studies.tables import table


def main(argv: list[str] | None = None) -> int:
    """Print the tables of docs/lateral.md about a model by wheel."""
    study_parser("by_wheel", main.__doc__).parse_args(argv)
    torch.set_num_threads(1)
    for kind in KINDS:
        chosen = motions(kind.rover)
        sys.stdout.write(f"{kind.rover}:\n\n{table(HEAD, lines(kind, chosen))}\n")
        turn = chosen[1 + TYPICAL[kind.rover]]
        hiding = [turn.but(name, hidden=name) for name in HIDDEN]
        sys.stdout.write(f"{kind.rover}, hidden:\n\n{table(HEAD, lines(kind, hiding))}\n")
        sys.stdout.flush()
    sys.stdout.write(f"skid-steer of 60 kg, 60 s:\n\n{table(BOUND_HEAD, bound_lines())}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
