# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""recover_bag BAG: make a whole bag from what is left of a damaged one, and report the losses.

Exit codes: 0 the new bag holds all that is left; 1 nothing is left; 2 wrong arguments, or the new
bag cannot be written.
"""

import argparse
import sys
from pathlib import Path

from terrain_estimator.bags import BagError, bag_name, recover
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.files.results import new_folder

NOTHING, WRONG = 1, 2
DAMAGED = "_damaged"


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Recover the bag that the command line names; return the exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    bag: Path = options.bag if options.bag.name not in {"", ".."} else options.bag.resolve()
    aside = bag.with_name(bag.name + DAMAGED)
    target = options.out or bag.with_name(f"{bag_name(bag)}_recovered")
    if options.replace and not bag.is_dir():
        parser.error(f"--replace: {options.bag} is not a folder: give the bag's folder")
    if options.replace and aside.exists():
        parser.error(f"--replace: {aside} exists already: move it away")
    try:
        with new_folder(target) as place:
            recovery = recover(bag, place)
        if options.replace and recovery.span.count:
            _exchange(bag, aside, target)
            target = bag
    except (BagError, OSError) as error:
        print(f"recover_bag: {error}", file=sys.stderr)
        return WRONG
    print(f"{target}: {recovery.words}")
    if options.replace and recovery.span.count:
        print(f"the damaged bag is now {aside}")
    return 0 if recovery.span.count else NOTHING


def _exchange(bag: Path, aside: Path, target: Path) -> None:
    """Give the new bag the name of the damaged one; undo that where it fails. Raises OSError."""
    bag.rename(aside)
    try:
        target.rename(bag)
    except OSError:
        aside.rename(bag)
        raise


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("recover_bag", __doc__)
    parser.add_argument(
        "bag",
        type=Path,
        metavar="BAG",
        help="folder of a bag or bare .mcap file; it is not changed",
    )
    parser.add_argument(
        "--out", type=Path, help="folder of the new bag, must not exist (default: BAG_recovered)"
    )
    parser.add_argument(
        "--replace",
        action="store_true",
        help=f"give the new bag the name of the damaged one, which is kept as BAG{DAMAGED}",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
