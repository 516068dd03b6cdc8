# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Date, commit and code of measured figures, and a mark where that code has changed since.

A page that a command writes has one line for each measurement, which :func:`measured` makes:

    Measured by `make accuracy` on 2026-11-22 at commit 1491324. <!-- code 0123456789abcdef -->

``make pages`` adds or removes the mark in every such line of the documentation and of the README.
"""

import ast
import hashlib
import re
import subprocess
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
_SOURCES = (
    ROOT,
    *(ROOT / name for name in ("terramechanics", "terrain_estimator", "rover_sim_node")),
)
_OURS = "terrain_estimator/terrain_estimator"
_NODES, _OFFLINE = f"{_OURS}/nodes", f"{_OURS}/offline"
_FOLDERS = {
    "accuracy": ("studies/accuracy",),
    "change": ("studies/change",),
    "long": ("studies/long",),
    "stream": ("studies/stream",),
    "recursion": ("studies/recursion",),
    "planner": ("studies/planner",),
    "net": ("studies/net",),
    "paper": ("studies/paper",),
    "calibrate": ("studies/calibration",),
    "hidden": ("tests/hidden/judge",),
    "faults": ("tests/faults", _NODES),
    "million": ("tests/faults",),
    "fuzz": ("tests/fuzz",),
    "bench": ("benchmarks", _OFFLINE, _NODES),
    "demo": (f"{_OURS}/cli", _NODES, "rover_sim_node/rover_sim_node"),
    "soak": ("benchmarks/soak", _NODES),
    "foreign": ("studies/foreign",),
    "foreign-discovery": ("studies/foreign_discovery",),
    "robustness": ("studies/robustness",),
    "measured": ("studies/measured",),
    "names": ("studies/false_names",),
    "independent-reference": ("studies/independent_reference",),
}
"""Folders whose modules each command of the Makefile runs; what they import follows."""
_NO_FIGURES = re.compile(
    r"(^|\.)(cli|console|importing|demonstration|rover_parameters)\b"
    r"|\.(__main__|config|model_file|outcome|topics|workers|records|command|pieces|tables?|lines"
    r"|page|targets|figures)$|^docs\.provenance$"
)
"""Modules that may change without any figure changing: they parse arguments, read and print.

This one is among them, so that a new study does not mark the pages of the others.
"""
_DATA = (".yaml", ".json")
RESULTS = ("docs/*.md", "tests/hidden/records")
"""Files that measurements write: one that ran before makes no other code of the next."""
_MARK = " **The code has changed since.**"
_LINE = re.compile(
    r"(?P<begin>Measured by `make (?P<command>[a-z-]+)[^`]*` on [\d-]+ at commit [^.\s]+\.)"
    r"(?: \*\*[^*]+\*\*)? <!-- code (?P<code>[\w-]+) -->"
)


def measured(command: str, arguments: str = "") -> str:
    """Return the line for figures that ``make COMMAND`` has measured now."""
    called = f'{command} ARGS="{arguments}"' if arguments else command
    date = datetime.now(UTC).date().isoformat()
    place = f"on {date} at commit {commit()}"
    return f"Measured by `make {called}` {place}. <!-- code {digest(command)} -->"


def refreshed(text: str) -> str:
    """Return ``text`` with the right mark in every line of :func:`measured`."""
    return _LINE.sub(_marked, text)


def _marked(line: re.Match[str]) -> str:
    code = line["code"]
    changed = code != digest(line["command"])
    return f"{line['begin']}{_MARK if changed else ''} <!-- code {code} -->"


@cache
def commit() -> str:
    """Return the commit of the work tree, with ``-dirty`` where other files than RESULTS differ.

    It is that of the first call: a process keeps the code that it has loaded.
    """
    differ = ("diff", "--quiet", "HEAD", "--", ".", *(f":(exclude){each}" for each in RESULTS))
    found = _git("describe", "--always").stdout.strip()
    return f"{found}{'-dirty' if _git(*differ).returncode else ''}" if found else "unknown"


def _git(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603


@cache
def digest(command: str, *more: str) -> str:
    """Hash the statements and data files from which a command's figures follow, and ``more``.

    Comments, docstrings and layout do not count. Raises KeyError for an unknown command.
    """
    found = hashlib.sha256()
    for name, path in sorted(_imported(_FOLDERS[command]).items()):
        if not _NO_FIGURES.search(name):
            found.update(ast.dump(_tree(path)).encode())
    packages = (ROOT / name / name for name in ("terramechanics", "terrain_estimator"))
    for path in sorted(path for package in packages for path in package.rglob("*.*")):
        if path.suffix in _DATA:
            found.update(path.read_bytes())
    for text in more:
        found.update(text.encode())
    return found.hexdigest()[:16]


def _imported(folders: Iterable[str]) -> dict[str, Path]:
    """Return the modules of ``folders``, and all modules of ours that they import, by name."""
    waiting = [_name(path) for folder in folders for path in (ROOT / folder).glob("*.py")]
    found: dict[str, Path] = {}
    while waiting:
        name = waiting.pop()
        path = None if name in found else _file(name)
        if path is not None:
            found[name] = path
            waiting += _names(path)
    return found


def _name(path: Path) -> str:
    source = max(
        (each for each in _SOURCES if path.is_relative_to(each)), key=lambda s: len(s.parts)
    )
    return ".".join(path.relative_to(source).with_suffix("").parts)


def _file(name: str) -> Path | None:
    places = (source.joinpath(*name.split(".")) for source in _SOURCES)
    files = (file for place in places for file in (place.with_suffix(".py"), place / "__init__.py"))
    return next((file for file in files if file.is_file()), None)


def _names(path: Path) -> Iterator[str]:
    """Yield the modules that a file imports, and imported names, which may be modules too."""
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


class _WithoutDocstrings(ast.NodeTransformer):
    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if text else node


@cache
def _tree(path: Path) -> ast.Module:
    tree = ast.parse(path.read_bytes())
    _WithoutDocstrings().visit(tree)
    return tree
