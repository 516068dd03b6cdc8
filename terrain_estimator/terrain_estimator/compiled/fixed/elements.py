# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fixed forms of operators on elements: expressions, which cost no loop of their own."""

from collections.abc import Callable
from typing import Any

import torch

from terrain_estimator.compiled.fixed.expressions import Expression, combined, number
from terrain_estimator.compiled.fixed.lengths import same, written
from terrain_estimator.compiled.fixed.recording import Place, Step, UnfitError
from terrain_estimator.compiled.fixed.writer import Writer
from terrain_estimator.compiled.graphs import Anything

_SAME = [
    "add", "sub", "mul", "div", "lt", "le", "gt", "ge", "eq", "ne", "remainder", "minimum",
    "maximum", "neg", "abs", "sign", "square", "reciprocal", "sqrt", "tan", "asin", "tanh", "exp",
    "expm1", "log", "erfc", "floor", "isfinite", "isnan", "isinf", "logical_not",
]  # fmt: skip
_NAMES = {name: name for name in _SAME} | {
    "__and__": "logical_and", "__or__": "logical_or", "where": "where", "addcmul": "addcmul",
    "pow": "pow", "clone": "same", "lerp": "lerp",
}  # fmt: skip
"""Operators on elements, by their names in scalar::."""


def _element(form: Writer, step: Step) -> None:
    """Leave an operator on elements to the loop that uses it."""
    (result,), name = step.results, step.name

    def read(value: Anything) -> Expression:
        return form.expression(value, result.sizes)

    if name in _SPECIAL:
        expression = _SPECIAL[name]([*step.arguments], read)
    else:
        count = {"where": 3, "addcmul": 3, "lerp": 3}.get(name) or len(
            [a for a in step.arguments[:2] if a is not None]
        )
        if name in ("add", "sub") and step.arguments[2] != same(1):
            raise UnfitError("a sum with a factor")
        parts = [read(a) for a in step.arguments[:count]]
        if name == "clone":
            parts = parts[:1]
        holes = ", ".join(f"{{{k}}}" for k in range(len(parts)))
        expression = combined(f"scalar::{_NAMES[name]}({holes})", parts)
    form.defer(result.buffer, expression.broadcast(result.sizes))


def _wave(form: Writer, step: Step) -> None:
    """Write sin or cos: the cheaper series where it holds for all."""
    (result,), source, name = step.results, step.arguments[0], step.name
    count = written(form.buffers[result.buffer].count)
    if source == form.rows(source.buffer, source.sizes) and form.is_used_again(source.buffer):
        pointer = form.pointer(source.buffer)
        form.new(result.buffer)
    else:
        expression, pointer = form.expression(source), f"b{result.buffer}"
        form.new(result.buffer)
        form.assign(form.rows(result.buffer, source.sizes), expression)
    form.lines.append(f"fixed::{name}({pointer}, b{result.buffer}, {count});")


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
    base, power = arguments
    if isinstance(power, Place):
        return combined("scalar::pow({0}, {1})", [read(base), read(power)])
    y = float(_plain(power))
    known = {
        2.0: "scalar::square({0})", 3.0: "scalar::cube({0})", 0.5: "scalar::sqrt({0})",
        -0.5: "scalar::reciprocal(scalar::sqrt({0}))", -1.0: "scalar::reciprocal({0})",
        -2.0: "scalar::reciprocal(scalar::square({0}))",
    }  # fmt: skip
    return combined(known.get(y, f"scalar::pow({{0}}, {number(y)})"), [read(base)])


def _plain(value: Anything) -> Anything:
    return value[0] if isinstance(value, tuple) else value


_SPECIAL: dict[str, Callable[[list[Any], _Read], Expression]] = {
    "clamp": _clamp,
    "rsub": _rsub,
    "to": _to,
    "pow": _power,
}
"""Operators with arguments of their own."""
ELEMENTS: dict[str, Callable[[Writer, Step], None]] = {
    **dict.fromkeys([*_NAMES, *_SPECIAL], _element),
    "sin": _wave,
    "cos": _wave,
}
