# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The operators that one call of a function runs, with the sizes and places of all tensors.

torch itself finds sizes, strides and what is a view of what: the call is run and watched. It is run
three times, with different numbers of hypotheses, so every integer of the record is three integers:
equal ones are constants of the model, others grow with the hypotheses.
"""

from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from terrain_estimator.compiled.fixed.interpretation import Interpreter
from terrain_estimator.compiled.graphs import Anything, Graphs

Number = tuple[int, int, int]
"""An integer in each of the three runs."""


class UnfitError(ValueError):
    """A call has no fixed form; the text says why. The general form does all that it could."""


@dataclass(frozen=True)
class Place:
    """A tensor: where its elements lie in a buffer."""

    buffer: int
    offset: Any
    sizes: tuple[Any, ...]
    strides: tuple[Any, ...]


@dataclass
class Buffer:
    """Memory of a tensor."""

    count: Any
    source: str = ""  # C++ of an argument or of a constant; empty where a step writes it
    constant: bool = False  # depends on no argument
    values: Tensor | None = None  # of a constant
    kind: str = "kReal"


@dataclass
class Step:
    """One operator with its arguments: places, numbers, lists of them, or None."""

    operator: str
    arguments: list[Any]
    results: list[Place]
    expected: bool = False  # of a guard

    @property
    def name(self) -> str:
        """The operator's name without its overload; of torch's own functions their path."""
        name = self.operator.removeprefix("aten::")
        return name if name.startswith("torch.") else name.split(".")[0]


@dataclass
class Record:
    """A call."""

    buffers: list[Buffer] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    sizes: dict[int, Any] = field(default_factory=dict)  # of each argument, by its buffer
    given: list[int] = field(default_factory=list)  # buffer of each argument's tensor; -1: empty
    touched: set[int] = field(default_factory=set)  # buffers that an operator was given
    result: Any = None


KINDS = {
    torch.float64: "kReal",
    torch.int64: "kInteger",
    torch.int32: "kInteger",
    torch.bool: "kBoolean",
}
_WITHOUT_NUMBERS = ("zeros_like", "ones_like", "full_like", "eye", "arange", "zeros", "ones")
"""Operators whose results do not depend on the numbers of a tensor."""


class _Watch:
    """Writes the record of one run."""

    def __init__(self, known: dict[int, str]) -> None:
        self.record = Record()
        self._known = known  # names of the model's constants, by the address of their memory
        self._buffers: dict[int, int] = {}  # by address
        self._alive: list[Tensor] = []

    def argument(self, value: Anything, source: str) -> Anything:
        """Note an argument, of which each tensor gets memory of its own, and return it."""
        if isinstance(value, Tensor):
            own = value.clone(memory_format=torch.contiguous_format)
            self.record.given.append(len(self.record.buffers) if own.numel() else -1)
            if own.numel():
                self.record.sizes[len(self.record.buffers)] = tuple(own.shape)
            self._new(own, source=source)
            return own
        if isinstance(value, tuple):
            return tuple(
                self.argument(each, f"std::get<{k}>({source})") for k, each in enumerate(value)
            )
        if isinstance(value, dict):
            return {
                name: self.argument(each, f"{source}[key::{name}]") for name, each in value.items()
            }
        return value

    def step(self, operator: str, given: list[Any], results: list[Any]) -> None:
        """Note an operator."""
        arguments = [self.place(value) for value in given]
        name = operator.split(".", maxsplit=1)[0]
        if name.endswith("_") and not name.endswith("__"):
            raise UnfitError(f"{operator} writes to what is there")
        if not results and not self._is_constant(arguments):
            raise UnfitError(f"{operator} takes numbers out of a tensor")
        self.record.touched |= {place.buffer for place in flat(arguments)}
        fresh = [r for r in _tensors(results) if not self._is_known(r)]
        for tensor in fresh:
            constant = operator.removeprefix("aten::").split(".")[0] in _WITHOUT_NUMBERS or all(
                self._is_constant(each) for each in arguments
            )
            self._new(tensor, constant=constant)
        places = [self.place(r) for r in results]
        if fresh and any(not isinstance(p, Place) for p in places):
            raise UnfitError(f"{operator} gives a list")
        if fresh:
            self.record.steps.append(Step(operator, arguments, places))

    def guard(self, value: Tensor) -> None:
        """Note a branch that the call took."""
        place = self.place(value)
        if not self._is_constant(place):
            self.record.steps.append(Step("guard", [place], [], bool(value)))

    def place(self, value: Anything) -> Anything:
        """Return where a tensor lies; lists of tensors likewise, other values as they are."""
        if isinstance(value, list | tuple):
            return [self.place(each) for each in value]
        if not isinstance(value, Tensor):
            return value
        if not self._is_known(value):
            name = self._known.get(value.untyped_storage().data_ptr(), "")
            self._new(value, source=f"k_{name}" if name else "", constant=True)
        if value.numel() == 0:
            buffer = self._empty(value)
        else:
            buffer = self._buffers[value.untyped_storage().data_ptr()]
        return Place(buffer, value.storage_offset(), tuple(value.shape), tuple(value.stride()))

    def _empty(self, value: Tensor) -> int:
        kind = KINDS.get(value.dtype, "")
        self.record.buffers.append(Buffer(0, constant=True, values=value, kind=kind))
        return len(self.record.buffers) - 1

    def _is_known(self, value: Tensor) -> bool:
        return value.numel() == 0 or value.untyped_storage().data_ptr() in self._buffers

    def _is_constant(self, argument: Anything) -> bool:
        if isinstance(argument, list):
            return all(map(self._is_constant, argument))
        return not isinstance(argument, Place) or self.record.buffers[argument.buffer].constant

    def _new(self, value: Tensor, source: str = "", *, constant: bool = False) -> None:
        if value.dtype not in KINDS:
            raise UnfitError(f"a tensor of {value.dtype}")
        self._alive.append(value)
        if value.numel() == 0:
            return
        if not value.is_contiguous() or value.storage_offset():
            raise UnfitError("a new tensor is not in rows")
        self._buffers[value.untyped_storage().data_ptr()] = len(self.record.buffers)
        self.record.buffers.append(
            Buffer(value.numel(), source, constant, value, KINDS[value.dtype])
        )


def record_call(
    graphs: Graphs, constants: dict[int, str], name: str, names: list[str], arguments: list[Any]
) -> Record:
    """Return the record of one call of a function, by its C++ name and those of its arguments."""
    watch = _Watch(constants)
    interpreter = Interpreter(graphs, watch=watch.step, branch=watch.guard, in_rows=True)
    given = [watch.argument(v, n) for v, n in zip(arguments, names, strict=True)]
    result = interpreter.named(name, given)
    watch.record.result = _placed(watch, result)
    return watch.record


def _placed(watch: _Watch, value: Anything) -> Anything:
    if isinstance(value, tuple):
        return tuple(_placed(watch, each) for each in value)
    if not isinstance(value, Tensor):
        raise UnfitError(f"it returns a {type(value).__name__}")
    return watch.place(value)


def merged(runs: list[Record]) -> Record:
    """Return three runs of one call as one record, whose integers are of three."""
    first = runs[0]
    if any(len(r.steps) != len(first.steps) or len(r.buffers) != len(first.buffers) for r in runs):
        raise UnfitError("the path depends on the number of hypotheses")
    buffers = [
        Buffer(_numbers([b.count for b in each]), each[0].source,
               each[0].constant and _do_not_change([b.values for b in each]),
               each[0].values, each[0].kind)
        for each in zip(*(r.buffers for r in runs), strict=True)
    ]  # fmt: skip
    steps = []
    for each in zip(*(r.steps for r in runs), strict=True):
        if len({s.operator for s in each}) > 1 or len({s.expected for s in each}) > 1:
            raise UnfitError("the path depends on the number of hypotheses")
        arguments = [_merged(list(a)) for a in zip(*(s.arguments for s in each), strict=True)]
        results = [_merged(list(a)) for a in zip(*(s.results for s in each), strict=True)]
        steps.append(Step(each[0].operator, arguments, results, each[0].expected))
    sizes = {
        buffer: tuple(_numbers(list(n)) for n in zip(*(r.sizes[buffer] for r in runs), strict=True))
        for buffer in first.sizes
    }
    return Record(
        buffers, steps, sizes, first.given, first.touched, _merged([r.result for r in runs])
    )


def _tensors(value: Anything) -> list[Tensor]:
    if isinstance(value, list | tuple):
        return [tensor for each in value for tensor in _tensors(each)]
    return [value] if isinstance(value, Tensor) else []


def _do_not_change(values: list[Tensor | None]) -> bool:
    """Return whether a tensor has the same numbers in all runs, as far as it has the same size."""
    first = values[0]
    return first is not None and all(
        v is not None
        and (v.shape != first.shape or torch.equal(v.nan_to_num(), first.nan_to_num()))
        for v in values
    )


def _merged(values: list[Any]) -> Anything:
    first = values[0]
    if isinstance(first, Place):
        if len({v.buffer for v in values}) > 1:
            raise UnfitError("tensors share memory by chance")
        return Place(
            first.buffer,
            _numbers([v.offset for v in values]),
            tuple(_numbers(list(n)) for n in zip(*(v.sizes for v in values), strict=True)),
            tuple(_numbers(list(n)) for n in zip(*(v.strides for v in values), strict=True)),
        )
    if isinstance(first, list | tuple):
        return type(first)(_merged(list(each)) for each in zip(*values, strict=True))
    if isinstance(first, int) and not isinstance(first, bool):
        return _numbers(values)
    if isinstance(first, torch.dtype | torch.device) or first is None:
        return first
    if any(repr(v) != repr(first) for v in values):
        raise UnfitError("a number depends on the number of hypotheses")
    return first


def _numbers(values: list[int]) -> Number:
    first, second, third = values
    return first, second, third


def flat(value: Anything) -> list[Place]:
    """Return the places within an argument or a result."""
    if isinstance(value, Place):
        return [value]
    if isinstance(value, list | tuple):
        return [place for each in value for place in flat(each)]
    return []
