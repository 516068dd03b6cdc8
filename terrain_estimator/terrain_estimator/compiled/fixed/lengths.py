# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Integers that may grow with the number of hypotheses, and the C++ made of them alone."""

from collections.abc import Sequence
from dataclasses import dataclass

from terrain_estimator.compiled.fixed.recording import Number, UnfitError

RUNS: Number = (2, 3, 4)
"""What grows, in the three runs: H in the C++, the number of hypotheses or 2 + an index."""


@dataclass(frozen=True)
class Looked:
    """A stride times a number that a table has for each index."""

    table: tuple[int, ...]
    stride: int

    @property
    def name(self) -> str:
        """The table's name in C++."""
        return "at_" + "_".join(map(str, self.table))


Stride = Number | Looked
"""How far one index moves, of a table or of the index itself."""


def same(value: int) -> Number:
    """Return an integer that is the same in all runs."""
    return value, value, value


def times(*values: Number) -> Number:
    """Return a product."""
    product = [1, 1, 1]
    for value in values:
        product = [a * b for a, b in zip(product, value, strict=True)]
    return product[0], product[1], product[2]


def plus(a: Number, b: Number) -> Number:
    """Return a sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def written(value: Number) -> str:
    """Return an integer in C++: a constant, or a polynomial of H.

    Raises:
        UnfitError: no polynomial of second degree with integers gives it.
    """
    a, b, c = value
    if a == b == c:
        return str(a)
    p, q, r = RUNS
    first, second = (b - a) / (q - p), (c - b) / (r - q)
    square = (second - first) / (r - p)
    linear = first - square * (p + q)
    start = a - square * p * p - linear * p
    whole = [round(x) for x in (start, linear, square)]
    if max(abs(x - n) for x, n in zip((start, linear, square), whole, strict=True)) > 1e-6:
        raise UnfitError(f"a size is {value} where others are {RUNS}")
    parts = [f"{whole[0]}"] if whole[0] else []
    parts += [f"{n} * {h}" for n, h in zip(whole[1:], ("H", "H * H"), strict=True) if n]
    return " + ".join(parts) if len(parts) == 1 else f"({' + '.join(parts)})"


def indexed(offset: Number, variables: Sequence[tuple[str, Stride]]) -> str:
    """Return an index in C++: an offset, and variables with their strides."""
    parts = [_walked(name, stride) for name, stride in variables if stride != same(0)]
    if offset != same(0) or not parts:
        parts.append(written(offset))
    return " + ".join(parts)


def _walked(name: str, stride: Stride) -> str:
    if isinstance(stride, Looked):
        name, stride = f"{stride.name}[{name}]", same(stride.stride)
    return name if stride == same(1) else f"{name} * {_bracketed(written(stride))}"


def _bracketed(text: str) -> str:
    return text if text.isdigit() or text.startswith("(") else f"({text})"


def nested(sizes: Sequence[Number], body: str, *, ivdep: bool = True) -> str:
    """Return loops of these sizes around a body, over i0, i1, ... from the outermost."""
    return nested_named([(f"i{k}", s) for k, s in enumerate(sizes)], body, ivdep=ivdep)


def nested_named(loops: Sequence[tuple[str, Number]], body: str, *, ivdep: bool = False) -> str:
    """Return loops around a body; the innermost one may take several numbers at once."""
    text = body
    for k, (name, size) in enumerate(reversed(loops)):
        hint = "\n#pragma GCC ivdep\n  " if k == 0 and ivdep else ""
        text = f"{hint}for (int64_t {name} = 0; {name} < {written(size)}; ++{name}) {text}"
    return text


Loop = tuple[Number, list[Stride]]
"""The size of a loop, and how far it moves each operand."""


def joined(
    sizes: Sequence[Number], strides: Sequence[Sequence[Stride]], order: Sequence[int]
) -> list[Loop]:
    """Return loops from the outermost, neighbours joined where all operands allow it."""
    loops: list[Loop] = []
    for d in order:
        size, own = sizes[d], [s[d] for s in strides]
        if size == same(1):
            continue
        if loops:
            outer, before = loops[-1]
            if all(_joins(b, s, size) for b, s in zip(before, own, strict=True)):
                loops[-1] = times(outer, size), own
                continue
        loops.append((size, own))
    return loops


def _joins(outer: Stride, inner: Stride, size: Number) -> bool:
    """Return whether two loops with these strides of an operand are one."""
    if isinstance(outer, Looked) or isinstance(inner, Looked):
        return False
    return outer == times(inner, size)
