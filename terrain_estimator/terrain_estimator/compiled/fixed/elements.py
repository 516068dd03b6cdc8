# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fixed forms of operators on elements.

Most are expressions, which cost no loop of their own. Elementary functions get one.
"""

from collections.abc import Callable
from typing import Any

import torch

from terrain_estimator.compiled.fixed.expressions import Expression, combined, number
from terrain_estimator.compiled.fixed.lengths import same, written
from terrain_estimator.compiled.fixed.pieces import Piece, broadcast, within
from terrain_estimator.compiled.fixed.recording import Place, Step, UnfitError
from terrain_estimator.compiled.fixed.writer import Writer
from terrain_estimator.compiled.graphs import Anything

_SAME = [
    "add", "sub", "mul", "div", "lt", "le", "gt", "ge", "eq", "ne", "remainder", "minimum",
    "maximum", "neg", "abs", "sign", "square", "reciprocal", "sqrt", "tan", "atan2", "erfc",
    "floor", "isfinite", "isnan", "isinf", "logical_not",
]  # fmt: skip
_NAMES = {name: name for name in _SAME} | {
    "__and__": "logical_and", "__or__": "logical_or", "where": "where", "addcmul": "addcmul",
    "clone": "same", "lerp": "lerp",
}  # fmt: skip
"""Operators on elements, by their names in scalar::."""


def _element(form: Writer, step: Step) -> None:
    """Leave an operator on elements to the loop that uses it."""
    (result,), values = step.results, _values(step)
    found, cuts = form.cuts(values, result.sizes)
    if not cuts:
        expression = _expression(step, [each[0].expression for each in found])
        form.defer(result.buffer, expression.broadcast(result.sizes))
        return
    pieces = []
    for at, start, length in cuts:
        sizes = [*result.sizes[:at], same(length), *result.sizes[at + 1 :]]
        parts = [
            within(broadcast(each, result.sizes, len(result.sizes)), at, start, length)
            for each in found
        ]
        expression = _expression(step, parts).broadcast(sizes)
        pieces.append(Piece(at, start, length, expression))
    form.wait(result, pieces)


def _values(step: Step) -> list[Any]:
    """Return the arguments of an operator on elements that are tensors or numbers of its own."""
    name, given = step.name, step.arguments
    if name in _SPECIAL:
        return given[: 2 if name == "rsub" else 1]
    if name in ("add", "sub") and given[2] != same(1):
        raise UnfitError("a sum with a factor")
    count = {"where": 3, "addcmul": 3, "lerp": 3, "clone": 1}.get(name) or len(
        [a for a in given[:2] if a is not None]
    )
    return given[:count]


def _expression(step: Step, parts: list[Expression]) -> Expression:
    """Return an operator on elements of its arguments."""
    name = step.name
    if name in _SPECIAL:
        rest = [*parts, *step.arguments[len(parts) :]]
        return _SPECIAL[name](rest, lambda value: value)
    holes = ", ".join(f"{{{k}}}" for k in range(len(parts)))
    return combined(f"scalar::{_NAMES[name]}({holes})", parts)


def _series(form: Writer, step: Step) -> None:
    """Write an elementary function as a loop of its own in the runtime, over rows of numbers."""
    (result,), source = step.results, step.arguments[0]
    exponent = [_spare(form, step.arguments[1], result)] if step.name == "pow" else []
    if _is_alike(form, source, result) and form.is_used_again(source.buffer):
        pointer = form.pointer(source.buffer)
        form.new(result.buffer)
    else:
        expression, pointer = form.expression(source), f"b{result.buffer}"
        form.new(result.buffer)
        form.assign(form.rows(result.buffer, result.sizes), expression)
    count = written(form.held(result.buffer))
    given = ", ".join([pointer, *exponent, f"b{result.buffer}", count])
    form.lines.append(f"series::{step.name}({given});")


def _spare(form: Writer, value: Anything, result: Place) -> str:
    """Return the pointer to a number for each of a result's."""
    if _is_alike(form, value, result):
        return form.pointer(value.buffer)
    expression = form.expression(value)
    place = form.spare(result)
    form.assign(place, expression)
    return form.pointer(place.buffer)


def _is_alike(form: Writer, value: Anything, result: Place) -> bool:
    """Return whether a value is a whole buffer, laid out like a result."""
    whole = isinstance(value, Place) and value == form.rows(value.buffer, result.sizes)
    return whole and form.is_alike(value.buffer, result.buffer)


def _pow(form: Writer, step: Step) -> None:
    """Write a power: of few known exponents as products."""
    power = step.arguments[1]
    known = not isinstance(power, Place) and float(_plain(power)) in _POWERS
    (_element if known else _series)(form, step)


_Read = Callable[[Any], Expression]


def _clamp(arguments: list[Any], read: _Read) -> Expression:
    x, low, high = arguments
    text, parts = "{0}", [read(x)]
    if low is not None:
        text = f"scalar::maximum({text}, {number(float(_plain(low)))})"
    if high is not None:
        text = f"scalar::minimum({text}, {number(float(_plain(high)))})"
    return combined(text, parts)


def _rsub(arguments: list[Any], read: _Read) -> Expression:
    return combined("scalar::neg(scalar::sub({0}, {1}))", [read(arguments[0]), read(arguments[1])])


def _to(arguments: list[Any], read: _Read) -> Expression:
    target = arguments[1]
    if target in (torch.float64, 7, same(7)):
        return combined("scalar::same({0})", [read(arguments[0])])
    raise UnfitError(f"a conversion to {target}")


def _power(arguments: list[Any], read: _Read) -> Expression:
    return combined(_POWERS[float(_plain(arguments[1]))], [read(arguments[0])])


def _plain(value: Anything) -> Anything:
    return value[0] if isinstance(value, tuple) else value


_SPECIAL: dict[str, Callable[[list[Any], _Read], Expression]] = {
    "clamp": _clamp,
    "rsub": _rsub,
    "to": _to,
    "pow": _power,
}
"""Operators with arguments of their own."""
_POWERS = {
    2.0: "scalar::square({0})", 3.0: "scalar::cube({0})", 0.5: "scalar::sqrt({0})",
    -0.5: "scalar::reciprocal(scalar::sqrt({0}))", -1.0: "scalar::reciprocal({0})",
    -2.0: "scalar::reciprocal(scalar::square({0}))",
}  # fmt: skip
"""Powers that need no logarithm, by their exponents."""
ELEMENTS: dict[str, Callable[[Writer, Step], None]] = {
    **dict.fromkeys([*_NAMES, *_SPECIAL], _element),
    **dict.fromkeys(["sin", "cos", "asin", "tanh", "exp", "expm1", "log"], _series),
    "pow": _pow,
}
