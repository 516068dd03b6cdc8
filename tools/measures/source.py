# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read a tree of Python files into modules and functions."""

import ast
import io
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("rover_parameters", "terramechanics", "terrain_estimator", "rover_sim_node")
SCRIPTS = ("studies", "benchmarks", "docs", "tools", "ros2_ws")
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Module:
    """A file of Python: dotted name, path below the root of the tree, text and syntax tree."""

    name: str
    path: Path
    text: str
    tree: ast.Module

    @property
    def is_test(self) -> bool:
        """Return whether the file is part of the tests."""
        return self.path.parts[0] == "tests"

    @property
    def in_package(self) -> bool:
        """Return whether the file belongs to a package that is installed."""
        return self.path.parts[0] in PACKAGES and len(self.path.parts) > 2

    def functions(self) -> Iterator[Function]:
        """Yield every function and method, nested ones too."""
        for node in ast.walk(self.tree):
            if isinstance(node, Function):
                yield node


def read(root: Path) -> list[Module]:
    """Return the modules of the packages, the studies, the scripts and the tests below a root."""
    modules = []
    for top in (*PACKAGES, *SCRIPTS, "tests"):
        for path in sorted((root / top).rglob("*.py")):
            below = path.relative_to(root)
            if not {"build", "install", "src", "log"} & set(below.parts[:-1]):
                text = path.read_text(encoding="utf-8")
                modules.append(Module(_name(below), below, text, ast.parse(text)))
    return modules


def _name(path: Path) -> str:
    parts = path.with_suffix("").parts
    inner = parts[1:] if parts[0] in PACKAGES and len(parts) > 2 else parts
    return ".".join(inner[:-1] if inner[-1] == "__init__" else inner)


def lines_of_code(text: str) -> set[int]:
    """Return the numbers of the lines that hold code: no blank lines, comments or docstrings."""
    skipped = {
        tokenize.COMMENT,
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENDMARKER,
    }
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in skipped:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        # a string that stands alone: a docstring of a module, class, function or attribute
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return lines
