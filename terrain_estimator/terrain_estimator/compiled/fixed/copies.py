# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fixed forms of what copies numbers or puts them together."""

from collections.abc import Callable

from terrain_estimator.compiled.fixed.expressions import Expression, Leaf, number
from terrain_estimator.compiled.fixed.lengths import plus, same
from terrain_estimator.compiled.fixed.pieces import Piece
from terrain_estimator.compiled.fixed.recording import Place, Step, UnfitError
from terrain_estimator.compiled.fixed.writer import Writer


def _copy(form: Writer, step: Step) -> None:
    (result,), source = step.results, step.arguments[0]
    pieces = form.pieces(source)
    form.new(result.buffer)
    form.assign_all(form.rows(result.buffer, source.sizes), pieces)


def _cat(form: Writer, step: Step) -> None:
    (result,), (parts, dim) = step.results, step.arguments
    at = dim[0] % len(result.sizes)
    found, start = [], 0
    for part in parts:
        # what is empty may have another number of dimensions
        length = part.sizes[at] if len(part.sizes) == len(result.sizes) else same(0)
        if len(set(length)) > 1:
            _cat_of_any_length(form, result, at, parts)
            return
        if length != same(0):
            found.append(Piece(at, start, length[0], form.expression(part)))
        start += length[0]
    form.wait(result, found)


def _cat_of_any_length(form: Writer, result: Place, at: int, parts: list[Place]) -> None:
    expressions = [form.expression(p) for p in parts if len(p.sizes) == len(result.sizes)]
    form.new(result.buffer)
    start = same(0)
    for expression in expressions:
        sizes = expression.sizes
        to = form.part(result, at, start, sizes[at])
        form.assign(to, expression)
        start = plus(start, sizes[at])


def _stack(form: Writer, step: Step) -> None:
    (result,), (parts, dim) = step.results, step.arguments
    at = dim[0] % len(result.sizes)
    found = []
    for k, part in enumerate(parts):
        one = form.expression(part).broadcast(part.sizes)
        leaves = [
            Leaf(e.buffer, e.offset, [*e.strides[:at], same(0), *e.strides[at:]])
            for e in one.leaves
        ]
        sizes = [*one.sizes[:at], same(1), *one.sizes[at:]]
        found.append(Piece(at, k, 1, Expression(sizes, one.text, leaves)))
    form.wait(result, found)


def _pad(form: Writer, step: Step) -> None:
    (result,) = step.results
    source, margins, mode, value = step.arguments
    if mode != "constant":
        raise UnfitError(f"pad has the mode {mode}")
    filled = 0.0 if value is None else float(value)
    expression = form.expression(source)
    form.new(result.buffer)
    form.assign(result, Expression([], number(filled), []))
    to = result
    for k in range(len(margins) // 2):
        at = len(result.sizes) - 1 - k
        to = form.part(to, at, margins[2 * k], expression.sizes[at])
    form.assign(to, expression)


def _diag_embed(form: Writer, step: Step) -> None:
    (result,), source = step.results, step.arguments[0]
    expression = form.expression(source)
    form.new(result.buffer)
    form.assign(result, Expression([], "0.0", []))
    *lead, row, column = result.strides
    to = Place(result.buffer, same(0), result.sizes[:-1], (*lead, plus(row, column)))
    form.assign(to, expression)


def _diag(form: Writer, step: Step) -> None:
    if len(step.arguments[0].sizes) != 1:
        raise UnfitError("diag of a matrix")
    _diag_embed(form, step)


def _index_select(form: Writer, step: Step) -> None:
    source, dim, places = step.arguments
    _taken(form, step, source, dim[0] % len(source.sizes), places)


def _index(form: Writer, step: Step) -> None:
    source, indices = step.arguments
    given = [k for k, each in enumerate(indices) if each is not None]
    if len(given) != 1:
        raise UnfitError("an index of several tensors")
    _taken(form, step, source, given[0], indices[given[0]])


def _taken(form: Writer, step: Step, source: Place, at: int, places: Place) -> None:
    index = form.buffers[places.buffer]
    if not index.constant or index.kind != "kInteger" or index.values is None:
        raise UnfitError("an index that depends on the arguments")
    (result,) = step.results
    form.pointer(source.buffer)
    chosen = index.values.flatten()[places.offset[0] :].tolist()[: places.sizes[0][0]]
    form.new(result.buffer)
    for k, place in enumerate(chosen):
        part = form.selected(source, at, same(int(place)))
        form.assign(form.selected(result, at, same(k)), form.expression(part))


COPIES: dict[str, Callable[[Writer, Step], None]] = {
    "reshape": _copy,
    "flatten": _copy,
    "contiguous": _copy,
    "cat": _cat,
    "stack": _stack,
    "pad": _pad,
    "torch.nn.functional.pad": _pad,
    "diag_embed": _diag_embed,
    "diag": _diag,
    "index_select": _index_select,
    "index": _index,
}
