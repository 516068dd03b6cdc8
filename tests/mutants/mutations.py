# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Single changes of a source file that a test ought to notice."""

import ast
import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

BINARY: dict[type[ast.operator], tuple[bytes, bytes]] = {
    ast.Add: (b"+", b"-"),
    ast.Sub: (b"-", b"+"),
    ast.Mult: (b"*", b"/"),
    ast.Div: (b"/", b"*"),
    ast.FloorDiv: (b"//", b"*"),
    ast.Mod: (b"%", b"*"),
    ast.Pow: (b"**", b"*"),
    ast.BitAnd: (b"&", b"|"),
    ast.BitOr: (b"|", b"&"),
}
COMPARED: dict[type[ast.cmpop], tuple[bytes, tuple[bytes, ...]]] = {
    ast.Lt: (b"<", (b"<=", b">=")),
    ast.LtE: (b"<=", (b"<", b">")),
    ast.Gt: (b">", (b">=", b"<=")),
    ast.GtE: (b">=", (b">", b"<")),
    ast.Eq: (b"==", (b"!=",)),
    ast.NotEq: (b"!=", (b"==",)),
    ast.Is: (b"is", (b"is not",)),
    ast.IsNot: (b"is not", (b"is",)),
    ast.In: (b"in", (b"not in",)),
    ast.NotIn: (b"not in", (b"in",)),
}
_PAIRS = (
    ("min", "max"),
    ("minimum", "maximum"),
    ("amin", "amax"),
    ("argmin", "argmax"),
    ("sin", "cos"),
    ("zeros", "ones"),
    ("zeros_like", "ones_like"),
    ("any", "all"),
    ("floor", "ceil"),
)
_LEFT = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)
SWAPPED = {one: other for pair in _PAIRS for one, other in (pair, pair[::-1])}
"""Functions, methods and keyword arguments that are taken for each other."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """A file with ``start`` to ``end`` [bytes] replaced."""

    file: str  # relative to the root, with forward slashes
    line: int  # from 1
    start: int
    end: int
    replacement: str
    original_line: str  # stripped; of a removed statement the first
    mutated_line: str

    def apply(self, source: bytes) -> bytes:
        """Return ``source`` with the replacement in it."""
        return source[: self.start] + self.replacement.encode() + source[self.end :]

    def key(self, source: bytes) -> str:
        """Return a name of this mutant of this ``source``."""
        return f"{self.file}:{self.line}:{hashlib.sha256(self.apply(source)).hexdigest()[:12]}"


def find_mutants(root: Path, file: str) -> list[Mutant]:
    """Return every mutant of ``file``, which is relative to ``root``."""
    source = (root / file).read_bytes()
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    found: dict[tuple[int, int, bytes], Mutant] = {}
    for start, end, replacement in finder.found:
        line = source.count(b"\n", 0, start) + 1
        first, last = source.rfind(b"\n", 0, start) + 1, source.find(b"\n", end)
        last = len(source) if last < 0 else last
        original = source[first:last].split(b"\n")[0]
        mutated = source[first:start] + replacement + source[end:last]
        found[start, end, replacement] = Mutant(
            file, line, start, end, replacement.decode(), original.decode().strip(),
            mutated.decode().strip(),
        )  # fmt: skip
    return list(found.values())


class _Finder(ast.NodeVisitor):
    """Collects (start, end, replacement) [bytes] of each change; the order follows the tree."""

    def __init__(self, source: bytes) -> None:
        self._source = source
        self._starts = [0, *(m.end() for m in re.finditer(rb"\n", source))]
        self.found: list[tuple[int, int, bytes]] = []

    def _span(self, node: ast.expr | ast.stmt | ast.keyword) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return (
            self._starts[node.lineno - 1] + node.col_offset,
            self._starts[node.end_lineno - 1] + node.end_col_offset,
        )

    def _text(self, node: ast.expr) -> bytes:
        start, end = self._span(node)
        return self._source[start:end]

    def _replace(self, node: ast.expr | ast.stmt, replacement: bytes) -> None:
        self.found.append((*self._span(node), replacement))

    def _between(self, left: ast.expr, right: ast.expr, token: bytes, *others: bytes) -> None:
        start, end = self._span(left)[1], self._span(right)[0]
        bare = re.sub(rb"#[^\n]*", lambda m: b" " * len(m.group()), self._source[start:end])
        at = start + bare.index(token)
        self.found.extend((at, at + len(token), other) for other in others)

    def visit(self, node: ast.AST) -> None:
        """Visit what a test has to notice: no texts, imports, or checks for the type checker."""
        if not isinstance(node, _LEFT):
            super().visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
            self.visit(default)
        self._visit_all(node.body)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._visit_all(node.body)

    def _visit_all(self, nodes: list[ast.stmt]) -> None:
        for node in nodes:
            self.visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        target = node.targets[0]
        if isinstance(target, ast.Name) and target.id in {"msg", "__all__"}:
            return
        if isinstance(target, ast.Subscript):
            self._replace(node, b"pass")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._replace(node, b"pass")
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Call):
            return  # a docstring
        if b"super()" not in self._text(node.value):
            self._replace(node, b"pass")
        self.generic_visit(node)

    def visit_Break(self, node: ast.Break) -> None:
        self._replace(node, b"pass")

    def visit_Continue(self, node: ast.Continue) -> None:
        self._replace(node, b"pass")

    def visit_BinOp(self, node: ast.BinOp) -> None:
        texts = [isinstance(x, ast.JoinedStr) or _is_text(x) for x in (node.left, node.right)]
        if type(node.op) in BINARY and not any(texts):
            self._between(node.left, node.right, *BINARY[type(node.op)])
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        sides = [node.left, *node.comparators]
        for left, op, right in zip(sides, node.ops, sides[1:], strict=False):
            token, others = COMPARED[type(op)]
            self._between(left, right, token, *others)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        token, other = (b"and", b"or") if isinstance(node.op, ast.And) else (b"or", b"and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._between(left, right, token, other)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        literal = isinstance(node.operand, ast.Constant)  # is changed itself
        if not isinstance(node.op, ast.UAdd) and not literal:
            self._replace(node, b"(" + self._text(node.operand) + b")")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._replace(node, str(not value).encode())
        elif isinstance(value, int):
            self._replace(node, str(value + 1).encode())
            if value:
                self._replace(node, str(value - 1).encode())
        elif isinstance(value, float):
            self._replace(node, repr(2.0 * value if value else 1.0).encode())
            if value:
                self._replace(node, repr(value / 10.0).encode())

    def visit_Call(self, node: ast.Call) -> None:
        if isinstance(node.func, ast.Name) and node.func.id in SWAPPED:
            self._replace(node.func, SWAPPED[node.func.id].encode())
        for keyword in node.keywords:
            if keyword.arg in SWAPPED:
                start = self._span(keyword)[0]
                self.found.append((start, start + len(keyword.arg), SWAPPED[keyword.arg].encode()))
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if node.attr in SWAPPED:
            end = self._span(node)[1]
            self.found.append((end - len(node.attr), end, SWAPPED[node.attr].encode()))
        self.generic_visit(node)

    def visit_If(self, node: ast.If | ast.While | ast.IfExp) -> None:
        self._replace(node.test, b"not (" + self._text(node.test) + b")")
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        self.visit_If(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self.visit_If(node)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def files_below(root: Path, folders: tuple[str, ...]) -> Iterator[str]:
    """Yield the modules below ``folders``, relative to ``root``."""
    for folder in folders:
        for path in sorted((root / folder).rglob("*.py")):
            yield path.relative_to(root).as_posix()
