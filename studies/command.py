# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Options and messages that the studies' commands share."""

import argparse
import os
import sys
from pathlib import Path

from terrain_estimator.console.arguments import COUNT


def study_parser(study: str, description: str | None) -> argparse.ArgumentParser:
    """Return the parser of ``python -m studies.STUDY``, whose help shows the defaults."""
    return argparse.ArgumentParser(
        prog=f"studies.{study}",
        description=description,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )


def add_model_option(
    parser: argparse.ArgumentParser,
    default: str = "",
    words: str = "name or file of the model; default: the estimator's default model",
) -> None:
    """Add ``--model``."""
    parser.add_argument("--model", default=default, help=words)


def add_record_options(parser: argparse.ArgumentParser, name: str, part: str) -> None:
    """Add the options of a study that computes parts, keeps them, and writes docs/NAME.md."""
    parser.add_argument(
        "--jobs",
        type=COUNT,
        default=os.cpu_count() or 1,
        help="processes at a time; the results do not depend on it",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=0.0,
        help=f"after which no {part} is begun; 0: until all is done",
    )
    parser.add_argument(
        "--records",
        type=Path,
        default=Path("out") / name,
        help=f"folder of the results of every {part}",
    )
    parser.add_argument(
        "--out", type=Path, default=Path(f"out/{name}.json"), help="file of all figures"
    )
    parser.add_argument(
        "--table", type=Path, default=Path(f"docs/{name}.md"), help="page of the tables"
    )


def refuse(study: str, reason: object, code: int = 2) -> int:
    """Print why a study ends, and return its exit code."""
    sys.stderr.write(f"studies.{study}: {reason}\n")
    return code


def refuse_too_short(study: str, part: str) -> int:
    """Print that the time was too short for one ``part``, and return exit code 1."""
    return refuse(
        study, f"not one {part} was done in this time; call it again, it goes on where it was", 1
    )
