# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the code of a folder, beside an earlier commit if one is given: `make measures`."""

import argparse
import subprocess
import tarfile
import tempfile
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from statistics import median

from tools.measures.measures import measures
from tools.measures.source import read
from tools.pictures.packages import packages_picture

ROOT = Path(__file__).parents[2]
START, END = "<!-- measures: written by make measures -->", "<!-- measures end -->"


def main(arguments: list[str] | None = None) -> int:
    """Print or write the table; returns the exit code."""
    options = _parser().parse_args(arguments)
    columns = [options.before] * bool(options.before) + [""]
    values = [_column(commit, options.folder, columns[0]) for commit in columns]
    lines = _table(options.folder, columns, values)
    print("\n".join(lines))
    if options.write:
        write(options.write, lines)
        picture = options.write.parent / "images/packages.svg"
        picture.write_text(packages_picture(read(options.folder)), encoding="utf-8")
    return 0


def write(page: Path, lines: list[str]) -> None:
    """Replace what stands between the marks of a page."""
    text = page.read_text(encoding="utf-8")
    head, start, rest = text.partition(START)
    _, end, tail = rest.partition(END)
    if not (start and end):
        message = f"{page}: expected the lines {START} and {END} around the table"
        raise SystemExit(message)
    page.write_text("\n".join([f"{head}{START}", *lines, f"{END}{tail}"]), encoding="utf-8")


def _table(folder: Path, columns: list[str], values: list[dict[str, str]]) -> list[str]:
    now = f"{_text(folder, 'rev-parse', '--short', 'HEAD')}{_changed(folder)}"
    command = "make measures" + (f' ARGS="--before {columns[0]}"' if len(columns) > 1 else "")
    heads = [_text(folder, "rev-parse", "--short", each) if each else now for each in columns]
    return [
        f"`{command}`, commit {now}, {datetime.now(UTC):%Y-%m-%d}:",
        "",
        "| measure | " + " | ".join(heads) + " |",
        "|---" * (1 + len(columns)) + "|",
        *(f"| {name} | " + " | ".join(each[name] for each in values) + " |" for name in values[0]),
    ]


def _column(commit: str, folder: Path, before: str) -> dict[str, str]:
    """Return the measures of a commit, or of the folder as it is."""
    if not commit:
        since = f"{before}..HEAD" if before else "HEAD"
        return measures(folder) | _subjects(folder, since)
    with tempfile.TemporaryDirectory() as tree:
        with tarfile.open(fileobj=BytesIO(_git(folder, "archive", commit))) as packed:
            packed.extractall(tree, filter="data")
        return measures(Path(tree)) | _subjects(folder, commit)


def _subjects(folder: Path, commits: str) -> dict[str, str]:
    subjects = _text(folder, "log", "--no-merges", "--format=%s", commits).splitlines()
    lengths = [len(subject) for subject in subjects]
    return {"characters of a commit's subject, median": f"{median(lengths):g}" if lengths else "-"}


def _changed(folder: Path) -> str:
    return " with changes" if _text(folder, "status", "--porcelain", "*.py") else ""


def _text(folder: Path, *arguments: str) -> str:
    return _git(folder, *arguments).decode().strip()


def _git(folder: Path, *arguments: str) -> bytes:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout  # noqa: S603


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.measures", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT, help="of a git checkout")
    parser.add_argument("--before", metavar="COMMIT", help="measure this commit too, for a column")
    parser.add_argument(
        "--write",
        metavar="PAGE",
        type=Path,
        help="replace the table in this page, and draw images/packages.svg beside it",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
