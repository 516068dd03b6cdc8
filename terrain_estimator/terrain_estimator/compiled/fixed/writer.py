# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a form consists of while it is written: memory, expressions that wait, and lines of C++."""

import re
from collections.abc import Sequence

import torch

from terrain_estimator.compiled.fixed.expressions import (
    Expression,
    Leaf,
    Walk,
    Walked,
    number,
)
from terrain_estimator.compiled.fixed.lengths import (
    Looked,
    Stride,
    indexed,
    joined,
    nested,
    plus,
    same,
    times,
    written,
)
from terrain_estimator.compiled.fixed.pieces import (
    Piece,
    Pieces,
    are_whole,
    broadcast,
    cost_little,
    cut,
    whole,
)
from terrain_estimator.compiled.fixed.recording import Buffer, Number, Place, UnfitError
from terrain_estimator.compiled.fixed.repeats import Layout, held, stepped
from terrain_estimator.compiled.graphs import Anything

_SLOW = re.compile(r"scalar::(div|reciprocal|sqrt|tan|erfc|remainder)\(")
"""Functions that take longer than to write a number and to read it."""
_MOST_USES = 3
"""Uses of what is joined and waits: each computes it anew."""


class Writer:
    """Writes the lines of one form, for those who know the operators."""

    def __init__(
        self,
        buffers: list[Buffer],
        returned: set[int],
        uses: dict[int, int],
        layouts: dict[int, Layout],
    ) -> None:
        """Take a call's buffers, which of them it returns, and how often each one is used.

        ``layouts`` are those of buffers that hold repeated slices once.
        """
        self.buffers = buffers
        self.layouts = layouts
        self.lines: list[str] = []
        self.made: set[int] = set()  # buffers that have their numbers
        self.temporary: dict[int, int] = {}  # numbers of each buffer that lives within the form
        self._returned, self._uses = returned, uses
        self._waiting: dict[int, Expression] = {}
        self._pieces: dict[int, Pieces] = {}
        self._tables: set[tuple[int, ...]] = set()

    # ---- memory

    def pointer(self, buffer: int) -> str:
        """Return the C++ pointer to a buffer that has its numbers."""
        if buffer in self._waiting:
            self.store(buffer, self._waiting.pop(buffer))
        if buffer in self._pieces:
            joined = self._pieces.pop(buffer)
            self.new(buffer)
            to = self.rows(buffer, [same(size) for size in joined.sizes])
            self.assign_all(to, joined.pieces)
        each = self.buffers[buffer]
        if buffer not in self.made:
            self.made.add(buffer)
            if each.constant and not each.source:
                values = each.values
                if values is None or each.count[0] != each.count[1]:
                    raise UnfitError("a constant grows with the hypotheses")
                listed = ", ".join(number(v) for v in values.to(torch.float64).flatten().tolist())
                self.lines.append(f"static constexpr double b{buffer}[] = {{{listed or '0.0'}}};")
        return each.source if each.constant and each.source else f"b{buffer}"

    def new(self, buffer: int) -> None:
        """Take memory for a buffer that a step writes."""
        each = self.buffers[buffer]
        if buffer in self.made:
            raise UnfitError("a buffer is written twice")
        self.made.add(buffer)
        count = written(self.held(buffer))
        if buffer in self._returned:
            self.lines.append(
                f"const Tensor o{buffer} = Tensor::empty(Integers{{{count}}}, Kind::{each.kind});"
                f" double* const b{buffer} = o{buffer}.data();"
            )
        elif count.isdigit():
            self.temporary[buffer] = int(count)
        else:
            self.lines.append(
                f"const Shared<Storage> o{buffer} = Storage::of({count});"
                f" double* const b{buffer} = o{buffer}->data();"
            )

    def held(self, buffer: int) -> Number:
        """Return how many numbers a buffer holds."""
        layout = self.layouts.get(buffer)
        return held(layout) if layout is not None else self.buffers[buffer].count

    def is_alike(self, one: int, other: int) -> bool:
        """Return whether two buffers of the same sizes hold each element at the same place."""
        return self.layouts.get(one) == self.layouts.get(other)

    def rows(self, buffer: int, sizes: Sequence[Number]) -> Place:
        """Return the whole of a buffer with these sizes."""
        strides, stride = [], same(1)
        for size in reversed(sizes):
            strides.append(stride)
            stride = times(stride, size)
        return Place(buffer, same(0), tuple(sizes), tuple(reversed(strides)))

    def spare(self, like: Place) -> Place:
        """Return memory that no step has asked for, laid out like a result."""
        buffer = len(self.buffers)
        self.buffers.append(Buffer(times(*like.sizes)))
        if like.buffer in self.layouts:
            self.layouts[buffer] = self.layouts[like.buffer]
        self.new(buffer)
        return self.rows(buffer, like.sizes)

    # ---- expressions

    def is_used_again(self, buffer: int) -> bool:
        """Return whether a buffer is used more than once, or returned."""
        return self._uses.get(buffer, 0) > 1

    def defer(self, buffer: int, expression: Expression) -> None:
        """Keep a buffer's expression for the loop that uses it, where only one does."""
        self._waiting[buffer] = expression
        if self._uses.get(buffer) != 1:
            self.pointer(buffer)

    def expression(self, value: Anything, within: Sequence[Number] | None = None) -> Expression:
        """Return an argument as an expression: what is pending where it is used here alone.

        A loop over sizes ``within`` that are larger would repeat it for each of its numbers: there
        slow functions are written down first.
        """
        if isinstance(value, tuple):
            if value[0] != value[1]:
                raise UnfitError("a number grows with the hypotheses")
            value = value[0]
        if not isinstance(value, Place):
            return Expression([], number(float(value)), [])
        sizes = list(value.sizes)
        pending = self._waiting.get(value.buffer)
        if (
            pending is not None
            and self._uses.get(value.buffer) == 1
            and value == self.rows(value.buffer, sizes)
            and pending.sizes == sizes
            and not (
                within is not None
                and times(*within) != times(*sizes)
                and _SLOW.search(pending.text)
            )
        ):
            del self._waiting[value.buffer]
            return pending
        self.pointer(value.buffer)
        return Expression(sizes, "{0}", [Leaf(value.buffer, value.offset, list(value.strides))])

    def stored(self, value: Place) -> Expression:
        """Return an argument as numbers that are written down."""
        self.pointer(value.buffer)
        return self.expression(value)

    def spelt(self, expression: Walked, index: list[list[tuple[str, Stride]]]) -> str:
        """Return an expression at an index of each leaf: variables with their strides."""
        texts = []
        for leaf, own in zip(expression.leaves, index, strict=True):
            for _, stride in own:
                self._keep(stride)
            texts.append(f"{self.pointer(leaf.buffer)}[{indexed(leaf.offset, own)}]")
        return re.sub(r"\{(\d+)\}", lambda m: texts[int(m[1])], expression.text)

    def walked(
        self, expression: Expression, chosen: Sequence[list[int] | None] | None = None
    ) -> Walked:
        """Return an expression whose leaves walk through what their buffers hold.

        ``chosen`` are the indices of each dimension that a loop takes, None for all of them.
        """
        every = [None] * len(expression.sizes) if chosen is None else chosen
        sizes = expression.sizes
        leaves = [
            Walk(leaf.buffer, *self._physical(leaf.buffer, leaf.offset, sizes, leaf.strides, every))
            for leaf in expression.leaves
        ]
        return Walked(_taken(sizes, every), expression.text, leaves)

    def _physical(
        self,
        buffer: int,
        offset: Number,
        sizes: Sequence[Number],
        strides: Sequence[Number],
        chosen: Sequence[list[int] | None],
    ) -> tuple[Number, list[Stride]]:
        """Return offset and strides of ``chosen`` indices in what a buffer holds."""
        layout = self.layouts.get(buffer)
        if layout is not None:
            whole = [size[0] for size in sizes]
            walk = layout.walked(offset[0], whole, [stride[0] for stride in strides])
            if walk is None:
                raise UnfitError("a view hides what repeats")
            return walk.physical(whole, chosen)
        found: list[Stride] = []
        for stride, indices in zip(strides, chosen, strict=True):
            if indices is None or stride == same(0):
                found.append(stride)
                continue
            if len(set(stride)) > 1:
                raise UnfitError("a stride grows beside what repeats")
            first, by = stepped(indices, stride[0])
            offset = plus(offset, same(first))
            found.append(by)
        return offset, found

    def _keep(self, stride: Stride) -> None:
        """Write the table of a stride, once."""
        if isinstance(stride, Looked) and stride.table not in self._tables:
            self._tables.add(stride.table)
            listed = ", ".join(map(str, stride.table))
            self.lines.insert(0, f"static constexpr int16_t {stride.name}[] = {{{listed}}};")

    def assign(self, to: Place, expression: Expression) -> None:
        """Write an expression into a place."""
        wide = expression.broadcast(to.sizes)
        for leaf in wide.leaves:
            self.pointer(leaf.buffer)
        chosen = self._chosen(to)
        walked = self.walked(wide, chosen)
        offset, own = self._physical(to.buffer, to.offset, to.sizes, to.strides, chosen)
        strides = [own, *(leaf.strides for leaf in walked.leaves)]
        order = sorted(range(len(to.sizes)), key=lambda d: -to.strides[d][1])
        loops = joined(walked.sizes, strides, order)
        index = [
            [(f"i{k}", own[n]) for k, (_, own) in enumerate(loops)] for n in range(len(strides))
        ]
        for _, stride in index[0]:
            self._keep(stride)
        target = f"b{to.buffer}[{indexed(offset, index[0])}]"
        body = f"{target} = {self.spelt(walked, index[1:])};"
        self.lines.append(nested([size for size, _ in loops], body))

    def _chosen(self, to: Place) -> list[list[int] | None]:
        """Return the indices of a place that write each number of its buffer once."""
        layout = self.layouts.get(to.buffer)
        if layout is None:
            return [None] * len(to.sizes)
        sizes = [size[0] for size in to.sizes]
        walk = layout.walked(to.offset[0], sizes, [stride[0] for stride in to.strides])
        if walk is None:
            raise UnfitError("a view hides what repeats")
        return walk.chosen(sizes)

    def store(self, buffer: int, expression: Expression) -> None:
        """Write an expression into a buffer of its own."""
        self.new(buffer)
        self.assign(self.rows(buffer, expression.sizes), expression)

    # ---- pieces

    def wait(self, to: Place, pieces: list[Piece]) -> None:
        """Keep what is joined for the loops that use it, where that costs less than to write it."""
        if self._may_wait(to, pieces):
            sizes = tuple(size[0] for size in to.sizes)
            self._pieces[to.buffer] = Pieces(sizes, pieces)
        else:
            self.new(to.buffer)
            self.assign_all(to, pieces)

    def _may_wait(self, to: Place, pieces: list[Piece]) -> bool:
        uses = self._uses.get(to.buffer, 0)
        if to.buffer in self._returned or not 1 <= uses <= _MOST_USES:
            return False
        if any(len(set(size)) > 1 for size in to.sizes):
            return False
        return not any(_SLOW.search(p.expression.text) for p in pieces) and cost_little(pieces)

    def pieces(self, value: Anything, within: Sequence[Number] | None = None) -> list[Piece]:
        """Return an argument as pieces, see :meth:`expression`."""
        if isinstance(value, Place) and value.buffer in self._pieces:
            larger = within is not None and times(*within) != times(*value.sizes)
            seen = None if larger else self._pieces[value.buffer].seen(value)
            if seen is not None:
                return seen
        return whole(self.expression(value, within))

    def cuts(
        self, values: Sequence[Anything], sizes: Sequence[Number]
    ) -> tuple[list[list[Piece]], list[tuple[int, int, int]]]:
        """Return arguments as pieces of these sizes, and where all of them are cut.

        There are no cuts where each is whole.
        """
        waiting = [v for v in values if isinstance(v, Place) and v.buffer in self._pieces]
        if len({p.at for v in waiting for p in self._broadcast(v, sizes)} - {-1}) > 1:
            for each in waiting:
                self.pointer(each.buffer)
        found = [self._broadcast(value, sizes) for value in values]
        return found, cut(found)

    def _broadcast(self, value: Anything, sizes: Sequence[Number]) -> list[Piece]:
        pieces = self.pieces(value, sizes)
        own = len(value.sizes) if isinstance(value, Place) else 0
        return broadcast(pieces, sizes, own) if not are_whole(pieces) else pieces

    def assign_all(self, to: Place, pieces: Sequence[Piece]) -> None:
        """Write pieces into a place."""
        for each in pieces:
            part = to
            if each.at >= 0:
                part = self.part(to, each.at, same(each.start), same(each.length))
            self.assign(part, each.expression)

    # ---- parts of a tensor

    def part(self, to: Place, at: int, start: Number, length: Number) -> Place:
        """Return ``length`` elements of a dimension from ``start`` on."""
        sizes = (*to.sizes[:at], length, *to.sizes[at + 1 :])
        offset = plus(to.offset, times(start, to.strides[at]))
        return Place(to.buffer, offset, sizes, to.strides)

    def selected(self, to: Place, at: int, place: Number) -> Place:
        """Return one element of a dimension, which then is gone."""
        offset = plus(to.offset, times(place, to.strides[at]))
        return Place(
            to.buffer, offset, to.sizes[:at] + to.sizes[at + 1 :],
            to.strides[:at] + to.strides[at + 1 :],
        )  # fmt: skip


def _taken(sizes: Sequence[Number], chosen: Sequence[list[int] | None]) -> list[Number]:
    """Return the sizes that are left where some indices are ``chosen``."""
    return [
        size if each is None else same(len(each)) for size, each in zip(sizes, chosen, strict=True)
    ]
