# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Expressions: a number for each index, in terms of tensors, until a loop writes or uses it."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from terrain_estimator.compiled.fixed.lengths import Stride, same
from terrain_estimator.compiled.fixed.recording import Number


def number(value: float) -> str:
    """Return a number in C++."""
    if math.isnan(value):
        return "elementary::kNaN"
    if value in (float("inf"), -float("inf")):
        return "elementary::kInfinity" if value > 0 else "(-elementary::kInfinity)"
    return f"({float(value)!r})"


@dataclass
class Leaf:
    """A tensor within an expression, by the strides of the expression's dimensions."""

    buffer: int
    offset: Number
    strides: Sequence[Number]


@dataclass
class Expression:
    """A number for each index, in terms of those of its leaves: {0}, {1}, ..."""

    sizes: list[Number]
    text: str
    leaves: list[Leaf]

    def broadcast(self, sizes: Sequence[Number]) -> "Expression":
        """Return the expression with these sizes."""
        more = len(sizes) - len(self.sizes)
        zero = same(0)
        leaves = [
            Leaf(
                leaf.buffer, leaf.offset,
                [zero] * more + [
                    zero if own == same(1) else stride
                    for own, stride in zip(self.sizes, leaf.strides, strict=True)
                ],
            )
            for leaf in self.leaves
        ]  # fmt: skip
        return Expression(list(sizes), self.text, leaves)


@dataclass(frozen=True)
class Walk:
    """A tensor within a loop: where it begins and how far each dimension moves."""

    buffer: int
    offset: Number
    strides: Sequence[Stride]


@dataclass(frozen=True)
class Walked:
    """An expression within a loop over these sizes."""

    sizes: list[Number]
    text: str
    leaves: list[Walk]


def common(expressions: Sequence[Expression]) -> list[Number]:
    """Return the sizes to which all are broadcast."""
    most = max(len(e.sizes) for e in expressions)
    sizes = [same(1)] * most
    for each in expressions:
        for d, size in enumerate(each.sizes, most - len(each.sizes)):
            if size != same(1):
                sizes[d] = size
    return sizes


def combined(text: str, parts: Sequence[Expression]) -> Expression:
    """Return ``text`` of {0}, {1}, ... with these parts in their places."""
    sizes = common(parts)
    leaves: list[Leaf] = []
    texts = []
    for part in parts:
        wide = part.broadcast(sizes)
        texts.append(_shifted(wide.text, len(leaves)))
        leaves += wide.leaves
    return Expression(sizes, re.sub(r"\{(\d+)\}", lambda m: texts[int(m[1])], text), leaves)


def _shifted(text: str, by: int) -> str:
    """Return a text whose leaves are counted from another number."""
    return re.sub(r"\{(\d+)\}", lambda m: f"{{{int(m[1]) + by}}}", text)
