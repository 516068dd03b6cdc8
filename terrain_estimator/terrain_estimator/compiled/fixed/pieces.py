# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Expressions put one behind the other, which wait for the loops that use them.

What is stacked only to be summed or multiplied need not be written down before: each piece goes
into a loop of its own.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from terrain_estimator.compiled.fixed.expressions import Expression, Leaf
from terrain_estimator.compiled.fixed.lengths import plus, same, times
from terrain_estimator.compiled.fixed.recording import Number, Place

_MOST_PIECES, _MOST_LEAVES = 4, 3
_SHORTEST_ROW = 8
"""Numbers that lie side by side in a piece."""


@dataclass(frozen=True)
class Piece:
    """An expression of a part of some sizes: ``length`` of the dimension ``at`` from ``start``."""

    at: int
    start: int
    length: int
    expression: Expression


def whole(expression: Expression) -> list[Piece]:
    """Return an expression as its only piece."""
    return [Piece(-1, 0, 0, expression)]


def are_whole(pieces: Sequence[Piece]) -> bool:
    """Return whether there is but one piece."""
    return pieces[0].at < 0


def cost_little(pieces: Sequence[Piece]) -> bool:
    """Return whether pieces may be computed anew by each of a few uses."""
    if are_whole(pieces) or len(pieces) > _MOST_PIECES:
        return False
    inner = times(same(1), *pieces[0].expression.sizes[pieces[0].at + 1 :])[0]
    return all(
        len(each.expression.leaves) <= _MOST_LEAVES and inner * each.length >= _SHORTEST_ROW
        for each in pieces
    )


def narrowed(expression: Expression, at: int, start: int, length: int) -> Expression:
    """Return ``length`` elements of a dimension from ``start`` on."""
    leaves = [
        Leaf(leaf.buffer, plus(leaf.offset, times(same(start), leaf.strides[at])), leaf.strides)
        for leaf in expression.leaves
    ]
    sizes = [*expression.sizes[:at], same(length), *expression.sizes[at + 1 :]]
    return Expression(sizes, expression.text, leaves)


def broadcast(pieces: Sequence[Piece], sizes: Sequence[Number], own: int) -> list[Piece]:
    """Return pieces of a tensor of ``own`` dimensions with these sizes."""
    found = []
    for each in pieces:
        if each.at < 0:
            return whole(each.expression.broadcast(sizes))
        at = each.at + len(sizes) - own
        wide = [*sizes[:at], same(each.length), *sizes[at + 1 :]]
        found.append(Piece(at, each.start, each.length, each.expression.broadcast(wide)))
    return found


def cut(operands: Sequence[Sequence[Piece]]) -> list[tuple[int, int, int]]:
    """Return the parts in which all operands have one piece: dimension, start, length.

    There are none where each is whole.
    """
    every = [piece for pieces in operands for piece in pieces if piece.at >= 0]
    ends = sorted({p.start for p in every} | {p.start + p.length for p in every})
    return [(every[0].at, a, b - a) for a, b in itertools.pairwise(ends)]


def within(pieces: Sequence[Piece], at: int, start: int, length: int) -> Expression:
    """Return the expression of a part that lies within one of the pieces."""
    if pieces[0].at < 0:
        return narrowed(pieces[0].expression, at, start, length)
    piece = next(p for p in pieces if p.start <= start < p.start + p.length)
    return narrowed(piece.expression, at, start - piece.start, length)


@dataclass(frozen=True)
class Pieces:
    """A tensor in rows as pieces along one dimension."""

    sizes: tuple[int, ...]
    pieces: list[Piece]

    def seen(self, place: Place) -> list[Piece] | None:
        """Return the pieces of a view; None where it mixes dimensions."""
        dims = _dimensions(self.sizes, place)
        if dims is None:
            return None
        start, walked = dims
        at = self.pieces[0].at
        mine = [j for j, each in enumerate(walked) if each and each[0] == at]
        if mine and (walked[mine[0]] or (0, 0))[1] != 1:
            return None
        found = []
        for piece in self.pieces:
            low = max(piece.start - start[at], 0)
            high = piece.start + piece.length - start[at]
            if mine:
                high = min(high, place.sizes[mine[0]][0])
            elif not piece.start <= start[at] < piece.start + piece.length:
                continue
            if mine and high <= low:
                continue
            origin = [*start]
            origin[at] += (low if mine else 0) - piece.start
            seen = _seen(piece.expression, origin, walked, place.sizes)
            if not mine:
                return whole(seen)
            j, length = mine[0], high - low
            seen.sizes[j] = same(length)
            found.append(Piece(j, low, length, seen))
        return found


def _seen(
    expression: Expression,
    origin: Sequence[int],
    walked: Sequence[tuple[int, int] | None],
    sizes: Sequence[Number],
) -> Expression:
    leaves = []
    for leaf in expression.leaves:
        offset = leaf.offset
        for k, stride in zip(origin, leaf.strides, strict=True):
            offset = plus(offset, times(same(k), stride))
        strides = [
            same(0) if each is None else times(leaf.strides[each[0]], same(each[1]))
            for each in walked
        ]
        leaves.append(Leaf(leaf.buffer, offset, strides))
    return Expression([*sizes], expression.text, leaves)


def _dimensions(
    sizes: tuple[int, ...], place: Place
) -> tuple[list[int], list[tuple[int, int] | None]] | None:
    """Return where a view of a tensor in rows begins, and which dimension each of its own is."""
    if any(len(set(n)) > 1 for n in (place.offset, *place.sizes, *place.strides)):
        return None
    return walk_of(
        sizes, place.offset[0], [s[0] for s in place.sizes], [s[0] for s in place.strides]
    )


def walk_of(
    whole: Sequence[int], offset: int, sizes: Sequence[int], strides: Sequence[int]
) -> tuple[list[int], list[tuple[int, int] | None]] | None:
    """Return where a view of a tensor [whole] in rows begins, and how it walks.

    That is for each dimension of the view the one of the tensor and the step in it, or None where
    the view stays. None instead of both where dimensions of the view are several of the tensor.
    """
    rows = rows_of(whole)
    start = [offset // stride % size for stride, size in zip(rows, whole, strict=True)]
    dims: list[tuple[int, int] | None] = []
    for size, stride in zip(sizes, strides, strict=True):
        if size == 1 or stride == 0:
            dims.append(None)
            continue
        q = next((q for q, s in enumerate(rows) if s <= stride and whole[q] > 1), None)
        if q is None or stride % rows[q]:
            return None
        step = stride // rows[q]
        if start[q] + (size - 1) * step >= whole[q] or any(e and e[0] == q for e in dims):
            return None
        dims.append((q, step))
    return start, dims


def rows_of(sizes: Sequence[int]) -> tuple[int, ...]:
    """Return the strides of a tensor in rows."""
    strides, stride = [], 1
    for size in reversed(sizes):
        strides.append(stride)
        stride *= size
    return tuple(reversed(strides))
