# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""C++ of one recorded call: loops of constant length, views that cost nothing, no small tensors.

An operator on elements that is used once becomes part of the loop that uses it. Every result is
summed in the order of the general form, so the bytes are the same. The C++ first compares sizes and
numbers with the recorded ones, and at each branch the way that was taken; where one differs it
gives up, and the general form runs.
"""

from collections.abc import Callable

from terrain_estimator.compiled.fixed.algebra import ALGEBRA
from terrain_estimator.compiled.fixed.copies import COPIES
from terrain_estimator.compiled.fixed.elements import ELEMENTS
from terrain_estimator.compiled.fixed.expressions import Expression, number
from terrain_estimator.compiled.fixed.lengths import written
from terrain_estimator.compiled.fixed.recording import Place, Record, Step, UnfitError, flat
from terrain_estimator.compiled.fixed.reductions import REDUCTIONS
from terrain_estimator.compiled.fixed.repeats import layouts
from terrain_estimator.compiled.fixed.room import packed
from terrain_estimator.compiled.fixed.writer import Writer
from terrain_estimator.compiled.graphs import Anything

_OPERATORS: dict[str, Callable[[Writer, Step], None]] = ELEMENTS | REDUCTIONS | COPIES | ALGEBRA
"""What writes an operator, by its name."""
_INEXACT = (
    "exp", "expm1", "log", "sin", "cos", "tan", "asin", "atan2", "tanh", "erfc", "pow", "igamma",
    "sum", "mean", "matmul", "dot", "mv", "softmax",
)  # fmt: skip
"""Operators that torch and the C++ may round in different ways."""


class FixedForm:
    """Writes one recorded call."""

    def __init__(self, record: Record) -> None:
        """Take a record of three runs."""
        self._record, self._buffers = record, record.buffers
        self._returned = {p.buffer for p in flat(record.result)}
        self._needed = self._find_needed()
        repeats = layouts(record, self._needed, [*ELEMENTS], [*REDUCTIONS, *COPIES])
        self._writer = Writer(record.buffers, self._returned, self._find_uses(), repeats)

    def text(self) -> tuple[str, list[int]]:
        """Return the body of the form, and the buffers of the arguments that it reads."""
        for step in self._needed:
            self._step(step)
        writer = self._writer
        read = writer.made | self._returned
        used = [b for b in range(len(self._buffers)) if self._is_argument(b) and b in read]
        for place in flat(self._record.result):
            writer.pointer(place.buffer)
        places, room = packed(writer.temporary, writer.lines)
        pointers = [f"double* const b{b} = room->data() + {at};" for b, at in places.items()]
        if room:
            pointers.insert(0, f"const Shared<Storage> room = Storage::of({room});")
        return "".join(f"  {line}\n" for line in [*pointers, *writer.lines]), used

    def returned(self, value: Anything) -> str:
        """Return the C++ of a result."""
        if isinstance(value, tuple):
            return f"std::make_tuple({', '.join(map(self.returned, value))})"
        sizes = ", ".join(map(written, value.sizes))
        strides = ", ".join(map(written, value.strides))
        buffer = self._buffers[value.buffer]
        owner = f"o{value.buffer}"
        if buffer.constant:
            raise UnfitError("it returns a constant")
        return (
            f"strided({owner}, Kind::{buffer.kind}, {written(value.offset)}, {{{sizes}}},"
            f" {{{strides}}})"
        )

    def _is_argument(self, buffer: int) -> bool:
        each = self._buffers[buffer]
        return bool(each.source) and not each.constant

    def _find_needed(self) -> list[Step]:
        """Return the steps that a result or a branch depends on."""
        wanted = set(self._returned)
        needed = []
        for step in reversed(self._record.steps):
            own = {p.buffer for p in flat(step.results)}
            if step.operator == "guard" or own & wanted:
                needed.append(step)
                wanted |= {p.buffer for p in flat(step.arguments)}
        return needed[::-1]

    def _find_uses(self) -> dict[int, int]:
        uses: dict[int, int] = {}
        for step in self._needed:
            for place in flat(step.arguments):
                uses[place.buffer] = uses.get(place.buffer, 0) + 1
        for buffer in self._returned:
            uses[buffer] = uses.get(buffer, 0) + 2
        return uses

    def _step(self, step: Step) -> None:
        writer = self._writer
        if step.operator == "guard":
            (place,) = step.arguments
            value = writer.spelt(writer.walked(writer.expression(place)), [[]])
            sign = "==" if step.expected else "!="
            writer.lines.append(f"if ({value} {sign} 0.0) return false;")
        elif all(self._buffers[p.buffer].constant for p in step.results):
            self._constant(step)
        elif step.name in _OPERATORS:
            _OPERATORS[step.name](writer, step)
        else:
            raise UnfitError(f"{step.operator} has no fixed form")

    def _constant(self, step: Step) -> None:
        """Keep what depends on no argument: nothing, or a number that fills it."""
        for place in step.results:
            buffer = self._buffers[place.buffer]
            if buffer.count[0] != buffer.count[1]:
                values = buffer.values
                if values is None or not bool((values == values.flatten()[0]).all()):
                    raise UnfitError(f"{step.operator} grows with the hypotheses")
                filled = number(float(values.flatten()[0]))
                buffer.constant = False
                self._writer.new(place.buffer)
                whole = self._writer.rows(place.buffer, [buffer.count])
                self._writer.assign(whole, Expression([], filled, []))
            elif step.name in _INEXACT and not (step.name == "sum" and self._whole(step)):
                raise UnfitError(f"{step.operator} of constants")

    def _whole(self, step: Step) -> bool:
        """Return whether all arguments are whole numbers, whose sum no order changes."""
        given = [
            self._buffers[each.buffer].values for each in step.arguments if isinstance(each, Place)
        ]
        return all(
            values is not None and bool((values == values.round()).all()) for values in given
        )
