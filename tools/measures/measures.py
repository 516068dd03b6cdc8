# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measure a tree of Python files: sizes, types, documentation, complexity, names, imports."""

import ast
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import median

from tools.measures.imports import circles, depth, graph
from tools.measures.source import Function, Module, lines_of_code, read

_BRANCHES = (
    ast.If,
    ast.IfExp,
    ast.For,
    ast.AsyncFor,
    ast.While,
    ast.ExceptHandler,
    ast.Assert,
    ast.comprehension,
    ast.match_case,
)
_ODD = ("What", "Where", "Whether")


def measures(root: Path) -> dict[str, str]:
    """Return the value of each measure by its name."""
    everything = read(root)
    code = [module for module in everything if not module.is_test]
    functions = [function for module in code for function in module.functions()]
    lengths = [_length(function) for function in functions]
    complexities = [complexity(function) for function in functions]
    files = [len(module.text.splitlines()) for module in code]
    packaged = graph([module for module in code if module.in_package])
    recurring = _recurring(code)
    return {
        "files / functions": f"{len(code)} / {len(functions)}",
        "lines of a function: median / 90th percentile / longest": _spread(lengths),
        "arguments and results with a type": _share(_typed(functions)),
        "public definitions with a docstring": _share(_documented(code)),
        "lines of tests per line of code": f"{_test_ratio(everything):.2f}",
        "cyclomatic complexity: 90th percentile / highest": _spread(complexities, middle=False),
        "lines of a file: 90th percentile / longest": _spread(files, middle=False),
        "most files in a folder": str(max(Counter(module.path.parent for module in code).values())),
        "loose modules in the root of terrain_estimator": str(_loose(code)),
        "longest chain of imports": str(depth(packaged)),
        "circles of imports": str(len(circles(packaged))),
        "class names that stand for more than one class": f"{len(recurring)}",
        "docstrings that begin with What, Where or Whether": _share(_oddly_begun(code)),
    }


def complexity(function: Function) -> int:
    """Return the cyclomatic complexity: one, and one more for each branch and each `and` or `or`.

    Functions inside of the function count for themselves.
    """
    count = 1
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, Function):
            continue
        if isinstance(node, ast.BoolOp):
            count += len(node.values) - 1
        elif isinstance(node, _BRANCHES):
            count += 1 + (len(node.ifs) if isinstance(node, ast.comprehension) else 0)
        waiting.extend(ast.iter_child_nodes(node))
    return count


def _length(function: Function) -> int:
    """Return the lines from `def` to the end without the docstring."""
    lines = (function.end_lineno or function.lineno) - function.lineno + 1
    first = function.body[0]
    if ast.get_docstring(function, clean=False) is not None:
        lines -= (first.end_lineno or first.lineno) - first.lineno + 1
    return lines


def _typed(functions: Iterable[Function]) -> list[bool]:
    given = []
    for function in functions:
        arguments = function.args
        named = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
        named += [each for each in (arguments.vararg, arguments.kwarg) if each]
        given += [each.annotation is not None for each in named if each.arg not in {"self", "cls"}]
        given.append(function.returns is not None)
    return given


def _documented(modules: Iterable[Module]) -> list[bool]:
    found = []
    for module in modules:
        found.append(ast.get_docstring(module.tree) is not None)
        waiting: list[ast.AST] = list(module.tree.body)
        while waiting:
            node = waiting.pop()
            if isinstance(node, (ast.ClassDef, Function)) and not node.name.startswith("_"):
                found.append(ast.get_docstring(node) is not None)
                waiting += node.body if isinstance(node, ast.ClassDef) else []
    return found


def _test_ratio(modules: Iterable[Module]) -> float:
    lines = Counter[bool]()
    for module in modules:
        lines[module.is_test] += len(lines_of_code(module.text))
    return lines[True] / lines[False]


def _loose(modules: Iterable[Module]) -> int:
    return sum(
        module.path.parent == Path("terrain_estimator/terrain_estimator")
        and module.path.name != "__init__.py"
        for module in modules
    )


def _recurring(modules: Iterable[Module]) -> list[str]:
    names = Counter(
        node.name
        for module in modules
        for node in ast.walk(module.tree)
        if isinstance(node, ast.ClassDef)
    )
    return sorted(name for name, count in names.items() if count > 1)


def _oddly_begun(modules: Iterable[Module]) -> list[bool]:
    texts = [
        text
        for module in modules
        for node in ast.walk(module.tree)
        if isinstance(node, (ast.Module, ast.ClassDef, Function))
        if (text := ast.get_docstring(node))
    ]
    return [bool(re.match(rf"({'|'.join(_ODD)})\b", text)) for text in texts]


def _spread(values: Sequence[int], *, middle: bool = True) -> str:
    ordered = sorted(values)
    shown = [ordered[int(0.9 * len(ordered))], ordered[-1]]
    return " / ".join(f"{value:g}" for value in ([median(ordered)] if middle else []) + shown)


def _share(flags: Sequence[bool]) -> str:
    return f"{100 * sum(flags) / len(flags):.1f} %" if flags else "-"
