# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run the fault matrix, a fault at every system call, and hostile states: `make faults`.

Every row of the matrix starts the real processes, applies a fault and reads their topics, log and
/diagnostics.
Its result is kept in OUT, a file for each row; the page is written from all of them. Exit code 1
where a row is not as expected.
"""

import argparse
import dataclasses
import json
import signal
import sys
import tempfile
import time
from pathlib import Path

from tests.faults import processes, recording, sections, stamps, values
from tests.faults.fault import Fault, Seen, complaints
from tests.faults.page import PAGE, matrix, replace_section
from tests.system.domains import own_domain

FAULTS = (*values.FAULTS, *stamps.FAULTS, *processes.FAULTS, *recording.FAULTS)
HEADING = "The matrix"


def main() -> int:
    """Run the chosen sections, print differences, and write them to the page."""
    options = _parser().parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that started processes end
    chosen = options.section or (["matrix"] if options.only else list(SECTIONS))
    return max(SECTIONS[name](options) for name in chosen)


def _calls(options: argparse.Namespace) -> int:
    text, right = sections.calls([])
    replace_section(options.page, sections.CALLS_HEADING, text)
    return int(not right)


def _states(options: argparse.Namespace) -> int:
    text, right = sections.hostile_states()
    replace_section(options.page, sections.STATES_HEADING, text)
    return int(not right)


def _matrix(options: argparse.Namespace) -> int:
    """Run the rows, print differences, and write the section of the page."""
    options.out.mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    chosen = [
        fault for fault in FAULTS if fault.name in (options.only or [each.name for each in FAULTS])
    ]
    wrong = [fault.name for fault in chosen if not _run(fault, options.out)]
    sys.stdout.write(
        f"{len(chosen)} rows in {time.monotonic() - begin:.0f} s; not as expected:"
        f" {', '.join(wrong) or 'none'}\n"
    )
    replace_section(
        options.page, HEADING, matrix([(fault, _kept(fault, options.out)) for fault in FAULTS])
    )
    return int(bool(wrong))


SECTIONS = {"matrix": _matrix, "calls": _calls, "states": _states}


def _run(fault: Fault, out: Path) -> bool:
    """Return whether all was as expected; only then the result is kept."""
    begin = time.monotonic()
    _file(fault, out).unlink(missing_ok=True)
    with tempfile.TemporaryDirectory() as folder, own_domain() as reserved:
        try:
            seen = fault.run(Path(folder), reserved)
            found = complaints(fault, seen)
        except Exception as error:  # noqa: BLE001 - the other rows are run all the same
            found = [f"{type(error).__name__}: {error}"]
        else:
            if not found:
                _file(fault, out).write_text(
                    json.dumps(dataclasses.asdict(seen), indent=1), encoding="utf-8"
                )
    sys.stdout.write(
        f"{fault.name}: {'NOT ' if found else ''}as expected, {time.monotonic() - begin:.0f} s\n"
    )
    sys.stdout.writelines(f"    {line}\n" for line in found)
    sys.stdout.flush()
    return not found


def _kept(fault: Fault, out: Path) -> Seen | None:
    """Return the last result of a row that was as expected."""
    path = _file(fault, out)
    return Seen(**json.loads(path.read_text(encoding="utf-8"))) if path.exists() else None


def _file(fault: Fault, out: Path) -> Path:
    return out / f"{fault.name.replace(' ', '_').replace(',', '')}.json"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="faults", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only",
        action="append",
        choices=[fault.name for fault in FAULTS],
        help="this row, again for more",
    )
    parser.add_argument(
        "--section", action="append", choices=SECTIONS, help="this section, again for more"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/faults"),
        help="folder of what was seen (default: %(default)s)",
    )
    parser.add_argument(
        "--page",
        type=Path,
        default=PAGE,
        help="whose section is replaced (default: docs/faults.md)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
