# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge verdicts about hidden effects: `make hidden`, a stratified sample, or `make hidden-full`.

Every case goes the whole way: drawn, sealed, read back from its bags, investigated. Records go to a
file in OUT as they come, and are not computed again. The command stops when the given time is over;
the page has the number of cases.

All cases of the field take a day. Their records are therefore a part of the repository: each has
the commit that it was examined at, and a later call goes on where they end. Remove the file to
examine all of them with the code of now.
"""

import argparse
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from docs.provenance import commit
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.offline.cluster import ClusterError, cluster
from tests.hidden.judge.bars import bars, field_bars, told_and_untold
from tests.hidden.judge.judging import Record, examine
from tests.hidden.judge.page import field, joined, page, rover
from tests.hidden.judge.strata import (
    Batch,
    batches,
    field_batches,
    nothing_batches,
    rover_batches,
)

FROZEN = "db20c94ee50f5270bbf4b428d5436c70eed56dbc"
"""Commit after which nothing that decides a verdict was changed."""
ROVER_FROZEN = "81280528e1295a926dee41e80f8b84e52e6973b9"
"""Commit that froze the rule for such cases. Younger are what FROZEN froze, and slip_sinkage."""
PAGE = Path(__file__).parents[3] / "docs" / "hidden.md"
KEPT = Path(__file__).parents[1] / "records"
"""Folder of the records of cases whose conditions are drawn."""
DIGITS = 6
"""Significant digits of the numbers of a record."""


def main() -> int:
    """Examine the missing cases and write the page.

    Exit code 2 where the scheduler does not answer.
    """
    options = _parser().parse_args()
    path = _file(options)
    path.parent.mkdir(parents=True, exist_ok=True)
    found = _kept(path)
    chosen = _chosen(options)
    known = {each["key"] for each in found}
    missing = [
        batch
        for batch in chosen
        if batch.family.startswith(options.family) and not known.issuperset(batch.keys)
    ]
    try:
        found += _examined(missing, path, options)
    except ClusterError as error:
        sys.stderr.write(f"hidden: {error}\n")
        return 2
    wanted = [key for batch in chosen for key in batch.keys]
    records = [each for each in found if each["key"] in wanted]
    text = options.page.read_text(encoding="utf-8") if options.page.exists() else ""
    if options.rover:
        every = [*records, *_others(found, options)]
        text = joined(text, None, None, rover(every, len(wanted), options.rover_frozen))
        table = told_and_untold(every)
    elif options.field:
        text = joined(text, None, field(records, len(wanted), options.frozen))
        table = field_bars(records)
    else:
        text = joined(text, page(records, len(wanted)), None)
        table = bars(records)
    options.page.write_text(text, encoding="utf-8")
    sys.stdout.write(f"{table}\n{options.page}: {len(records)} of {len(wanted)} cases\n")
    return 0


def _chosen(options: argparse.Namespace) -> list[Batch]:
    """Return the cases that the options ask for."""
    if options.rover:
        return rover_batches(options.rover_frozen, untold=options.untold)
    if options.field:
        return [*field_batches(options.frozen), *nothing_batches(options.frozen)]
    return batches(whole=options.full)


def _file(options: argparse.Namespace) -> Path:
    """Return the file of the records of these cases."""
    name = "rover" if options.rover else "field" if options.field else "cases"
    folder = Path("out/hidden") if name == "cases" else KEPT
    return (options.out or folder) / f"{name}.jsonl"


def _others(found: list[Record], options: argparse.Namespace) -> list[Record]:
    """Return the records of the rover's cases with the deviations, or without where asked with."""
    others = rover_batches(options.rover_frozen, untold=not options.untold)
    keys = {key for batch in others for key in batch.keys}
    return [each for each in found if each["key"] in keys]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="hidden", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--full", action="store_true", help="all cases, not only the sample")
    parser.add_argument(
        "--field",
        action="store_true",
        help="the cases whose conditions are drawn, instead of those whose are set",
    )
    parser.add_argument(
        "--frozen",
        default=FROZEN,
        help="commit that froze the rule, the seed of those cases (default: %(default)s)",
    )
    parser.add_argument(
        "--rover",
        action="store_true",
        help="with --field: the cases whose rover is not that of its file",
    )
    parser.add_argument(
        "--untold",
        action="store_true",
        help="with --rover: do not tell the search the deviations, as the command does by default",
    )
    parser.add_argument(
        "--rover-frozen",
        default=ROVER_FROZEN,
        help="commit that froze the rule for --rover, the seed of its cases (default: %(default)s)",
    )
    parser.add_argument(
        "--family", default="", help="examine only families whose names begin so (default: all)"
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=40.0,
        help="after which to stop, 0: never (default: %(default)s)",
    )
    parser.add_argument(
        "--workers", type=int, default=2, help="processes of this machine (default: %(default)s)"
    )
    parser.add_argument(
        "--scheduler",
        default="",
        help="address of a dask.distributed scheduler that takes the work; default: this machine",
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="folder of the records (default: out/hidden, with --field tests/hidden/records)",
    )
    parser.add_argument(
        "--page", type=Path, default=PAGE, help="file of the tables (default: docs/hidden.md)"
    )
    return parser


def _kept(path: Path) -> list[Record]:
    """Return the records of an earlier call, without a last line that was cut off."""
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    whole = [line for line in lines if line.endswith("\n")]
    path.write_text("".join(whole), encoding="utf-8")
    return [json.loads(line) for line in whole]


def _examined(missing: list[Batch], path: Path, options: argparse.Namespace) -> list[Record]:
    """Return the records of the missing cases, as many as there is time for, in their order."""
    found: list[Record] = []
    now = commit()  # before a record in the work tree makes it another one
    end = time.monotonic() + 60.0 * options.minutes if options.minutes else float("inf")
    if not missing:
        return found
    with (
        cluster(options.scheduler, options.workers) as spread,
        ProgressReport("hidden cases") as report,
        path.open("a", encoding="utf-8") as output,
    ):
        for number, records in enumerate(spread(examine, missing), 1):
            kept = [_rounded(record) | {"commit": now} for record in records]
            found += kept
            output.writelines(json.dumps(record) + "\n" for record in kept)
            output.flush()
            report.at(number / len(missing), records[-1]["key"])
            if time.monotonic() > end:
                break
    return found


def _rounded(value: Any) -> Any:
    """Return what a record holds with numbers of :data:`DIGITS` digits."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, Mapping):
        return {name: _rounded(each) for name, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list | tuple) else value


if __name__ == "__main__":
    sys.exit(main())
