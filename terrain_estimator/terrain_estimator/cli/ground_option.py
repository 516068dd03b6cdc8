# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The option of commands that write a model for ground that varies, and how its file is named."""

from argparse import ArgumentParser

from terrain_estimator.console.arguments import real
from terrain_estimator.model.prior import DEFAULT_PRIOR

ON_VARYING_GROUND = "_on_varying_ground"
"""End of the name of such a model."""
_LARGEST = 0.3  # beyond it a deviation is no small change of the forces


def add_ground_variation(parser: ArgumentParser, apart: str) -> None:
    """Add ``--ground-variation``; ``apart`` is what stands on different ground."""
    parser.add_argument(
        "--ground-variation",
        type=real(0.0, _LARGEST),
        default=DEFAULT_PRIOR.ground_variation,
        metavar="SD",
        help=f"relative deviation of the ground's strength and stiffness from {apart} to {apart};"
        " 0: it is the same everywhere (default: %(default)s)",
    )
