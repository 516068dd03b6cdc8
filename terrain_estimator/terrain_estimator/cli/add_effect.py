# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""add_effect --effect NAME[=SIZE+-SD]: add named effects to a model, which then estimates them.

SIZE and SD are prior knowledge of the effect, in its unit; without them the prior has mean 0 and
half of the physical range as its standard deviation. The estimator takes the file as it is: ros2
run terrain_estimator estimator --ros-args -p model:=FILE. Exit codes: 0, or 2 for a bad argument.
"""

import argparse
import re
import sys
from pathlib import Path

from rover_parameters.records import ConfigError
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.files.results import adding
from terrain_estimator.learning.adding import Sized, add_effects
from terrain_estimator.model.metadata import DEFAULT_MODEL, ModelFileError
from terrain_estimator.model.model_file import load_model
from terrain_estimator.offline.reference_drives import ENDING as DRIVE
from terrain_estimator.offline.reference_drives import copy_drives

WRONG = 2
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_GIVEN = re.compile(rf"(\w+)(?:={_NUMBER}\s*\+-\s*{_NUMBER})?")


def sized(text: str) -> Sized:
    """Parse ``NAME`` or ``NAME=SIZE+-SD``; a ConfigError quotes the text."""
    match = _GIVEN.fullmatch(text)
    if match is None:
        raise ConfigError(
            f"--effect {text!r}: expected NAME or NAME=SIZE+-SD, such as slope_bias=0.02+-0.01"
        )
    name, mean, sd = match.groups()
    return Sized.of_library(name) if mean is None else Sized(name, float(mean), float(sd))


def model_path(text: str) -> Path:
    """Return the path of the file to write; ArgumentTypeError where it does not end with .pt."""
    path = Path(text)
    if path.suffix != ".pt":
        raise argparse.ArgumentTypeError(f"{text!r}: the name of a model file must end with .pt")
    return path


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Write the model that the command line asks for; return the exit code."""
    parser = command_parser("add_effect", __doc__)
    parser.add_argument(
        "--effect",
        action="append",
        required=True,
        metavar="NAME[=SIZE+-SD]",
        help="may be given several times",
    )
    parser.add_argument(
        "--model",
        default=DEFAULT_MODEL,
        help="name or file of the model to extend (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        type=model_path,
        default=Path("model.pt"),
        help="new file to write, ending with .pt (default: %(default)s)",
    )
    options = parser.parse_args(arguments)
    try:
        effects = [sized(text) for text in options.effect]
        out: Path = options.out
        names = out.name, out.with_suffix(".json").name, out.stem + DRIVE
        with adding(out.parent, *names) as new:
            metadata = add_effects(load_model(options.model), effects, new / out.name)
            copy_drives(options.model, metadata, new / names[-1])
    except (ConfigError, ModelFileError, OSError) as error:
        sys.stderr.write(f"add_effect: {error}\n")
        return WRONG
    sys.stdout.write(f"{options.out}: {metadata.model_id}, {metadata.size} bytes\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
