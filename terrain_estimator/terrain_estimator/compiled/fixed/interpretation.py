# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: ARG002 (every part of a graph takes the same arguments)
"""Runs the graphs of a TorchScript model one operator at a time, so that one can watch it.

The numbers are torch's own. What is watched decides where the C++ gets a second form for the sizes
and the path that a drive took (``recording``).
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch

from terrain_estimator.compiled.graphs import (
    Anything,
    Block,
    Graph,
    Graphs,
    Node,
    joined,
    overload_of,
)

Watch = Callable[[str, list[Any], list[Any]], None]
Enter = Callable[[str, list[Any]], None]
Branch = Callable[[Any], None]


def _set_item(target: Anything, key: Anything, value: Anything) -> None:
    target[key] = value


_PYTHON: dict[str, Callable[..., Any]] = {
    "aten::__getitem__": operator.getitem,
    "aten::_set_item": _set_item,
    "aten::__contains__": operator.contains,
    "aten::copy": dict.copy,
    "aten::keys": lambda a: list(a.keys()),
    "aten::len": len,
    "aten::append": list.append,
    "aten::list": list,
    "aten::count": list.count,
    "aten::__is__": operator.is_,
    "aten::__isnot__": operator.is_not,
    "aten::__not__": operator.not_,
    "prim::max": max,
    "prim::min": min,
    "prim::dtype": lambda x: x.dtype,
    "prim::device": lambda x: x.device,
    "prim::tolist": lambda x, *_: x.tolist(),
    "aten::dim": lambda x: x.dim(),
    "aten::floordiv": operator.floordiv,
    "aten::Bool": bool,
    "aten::Int": int,
}
"""Operators on numbers, lists and dictionaries."""
_ARITHMETIC: dict[str, Callable[..., Any]] = {
    "aten::add": operator.add, "aten::sub": operator.sub, "aten::mul": operator.mul,
    "aten::div": operator.truediv, "aten::pow": operator.pow, "aten::neg": operator.neg,
    "aten::lt": operator.lt, "aten::le": operator.le, "aten::gt": operator.gt,
    "aten::ge": operator.ge, "aten::eq": operator.eq, "aten::ne": operator.ne,
    "aten::__and__": operator.and_, "aten::__or__": operator.or_,
}  # fmt: skip
"""Operators that are also on tensors, where torch does them."""
_TAKEN_OUT = ("aten::Int", "aten::Float", "aten::item", "prim::tolist")
"""Operators that make plain numbers of a tensor."""
_NOTHING = ("prim::device", "prim::layout", "prim::Print")


class Interpreter:
    """Runs a model's methods. What is called and computed is told to whoever watches."""

    def __init__(
        self,
        graphs: Graphs,
        enter: Enter | None = None,
        watch: Watch | None = None,
        branch: Branch | None = None,
        *,
        in_rows: bool = False,
    ) -> None:
        """Take a model's graphs.

        ``enter`` is told each function's C++ name and its arguments, ``watch`` each operator on
        tensors with its arguments and results, ``branch`` each truth value that comes of a tensor.
        ``in_rows`` lays new tensors out by rows, as the C++ does.
        """
        self._graphs = graphs
        self._enter, self._watch, self._branch = enter, watch, branch
        self._in_rows = in_rows

    def method(self, path: str, name: str, arguments: list[Any]) -> Anything:
        """Return what a method of the module at ``path`` returns."""
        own, graph = self._graphs.method(path, name)
        return self._function(own, graph, path, arguments)

    def function(self, qualified: str, arguments: list[Any]) -> Anything:
        """Return what a function returns, by its qualified name."""
        name, graph = self._graphs.function(qualified)
        return self._function(name, graph, None, arguments)

    def named(self, name: str, arguments: list[Any]) -> Anything:
        """Return what a function or method returns, by its C++ name."""
        graph, path = self._graphs.by_name(name)
        return self._function(name, graph, path, arguments)

    def _function(
        self, name: str, graph: Graph, path: str | None, arguments: list[Any]
    ) -> Anything:
        if self._enter is not None:
            self._enter(name, arguments)
        decoded = self._graphs.decoded.get(name)
        if decoded is None:
            decoded = self._graphs.decoded[name] = _block_of(graph)
        given = arguments if path is None else [_Module(path), *arguments]
        (result,) = self._block(decoded, given, {})
        return result

    def _block(self, block: "_Block", given: list[Any], values: dict[str, Any]) -> list[Any]:
        """Return the outputs of a block; ``values`` are those of the blocks around it, by name."""
        values.update(zip(block.inputs, given, strict=True))
        for node in block.nodes:
            arguments = [values.get(name) for name in node.inputs]
            if node.special is None:
                results = self._operator(node, arguments)
            else:
                results = node.special(self, node, arguments, values)
            values.update(zip(node.outputs, results, strict=True))
        return [values[name] for name in block.outputs]

    def _operator(self, node: "_Node", given: list[Any]) -> list[Any]:
        kind, overload, count = node.kind, node.overload, len(node.outputs)
        on_tensors = any(_has_tensor(v) for v in given)
        if kind == "aten::Bool" and on_tensors and self._branch is not None:
            self._branch(given[0])
        elif kind in _TAKEN_OUT and on_tensors and self._watch is not None:
            self._watch(overload, given, [])
        if kind in _PYTHON:
            result = _PYTHON[kind](*given)
            if kind == "aten::append":
                result = given[0]
            return [result] if count else []
        if kind in _ARITHMETIC and not any(isinstance(v, torch.Tensor) for v in given):
            return [_ARITHMETIC[kind](*given)]
        if kind == "aten::slice" and isinstance(given[0], list):
            return [given[0][slice(*given[1:])]]
        results = self._torch(overload, given, count)
        if self._watch is not None and any(_has_tensor(r) for r in results):
            self._watch(overload, given, results)
        return results

    def _torch(self, overload: str, given: list[Any], count: int) -> list[Any]:
        name, _, form = overload.removeprefix("aten::").partition(".")
        packet: Any = getattr(torch.ops.aten, name)
        function: Any = getattr(packet, form or "default")
        arguments = function._schema.arguments  # noqa: SLF001 (nowhere else)
        plain = [v for v, a in zip(given, arguments, strict=True) if not a.kwarg_only]
        named = {a.name: v for v, a in zip(given, arguments, strict=True) if a.kwarg_only}
        result = function(*plain, **named)
        results = [result] if count == 1 else list(result)
        if self._in_rows:
            views = {v.untyped_storage().data_ptr() for v in _tensors(given)}
            results = [
                r.contiguous()
                if isinstance(r, torch.Tensor) and r.untyped_storage().data_ptr() not in views
                else r
                for r in results
            ]
        return results

    # ---- what is not an operator

    def _nothing(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [None]

    def _constant(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [node.constant]

    def _getattr(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        path = given[0].path
        if node.gives_module:
            return [_Module(joined(path, node.name))]
        return [self._graphs.attribute(path, node.name)]

    def _callmethod(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [self.method(given[0].path, node.name, given[1:])]

    def _callfunction(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        qualified = node.name
        if not qualified.startswith("__torch__.torch."):
            return [self.function(qualified, given[1:])]
        function: Any = torch
        for part in qualified.removeprefix("__torch__.torch.").split("."):
            function = getattr(function, part)
        result = function(*given[1:])
        if self._watch is not None:
            self._watch(qualified.removeprefix("__torch__."), given[1:], [result])
        return [result]

    def _listconstruct(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [given]

    def _tupleconstruct(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [tuple(given)]

    def _dictconstruct(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [dict(zip(given[::2], given[1::2], strict=True))]

    def _listunpack(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return list(given[0])

    def _tupleunpack(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return list(given[0])

    def _tupleindex(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [given[0][given[1]]]

    def _unchecked_cast(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return given

    def _uninitialized(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [None]

    def _raiseexception(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        raise RuntimeError(given[0])

    def _if(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        yes, no = node.blocks
        return self._block(yes if given[0] else no, [], values)

    def _loop(self, node: "_Node", given: list[Any], values: dict[str, Any]) -> list[Any]:
        most, goes, *carried = given
        (block,) = node.blocks
        count = 0
        while goes and count < most:
            goes, *carried = self._block(block, [count, *carried], values)
            count += 1
        return list(carried)


Special = Callable[[Interpreter, "_Node", list[Any], dict[str, Any]], list[Any]]


@dataclass(frozen=True, slots=True)
class _Block:
    """What a block of a graph does; torch's own objects are slow to ask."""

    inputs: tuple[str, ...]
    nodes: tuple["_Node", ...]
    outputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Node:
    """One node of a block."""

    kind: str
    overload: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    special: Special | None  # what it does where it is no operator
    constant: Any  # of a constant
    name: str  # of the attribute, method or function
    gives_module: bool
    blocks: tuple[_Block, ...]


def _block_of(block: Block) -> _Block:
    """Return what a graph or block does."""
    return _Block(
        tuple(each.debugName() for each in block.inputs()),
        tuple(map(_node_of, block.nodes())),
        tuple(each.debugName() for each in block.outputs()),
    )


def _node_of(node: Node) -> _Node:
    kind, inputs, outputs = node.kind(), list(node.inputs()), list(node.outputs())
    special: Special | None = None
    if kind in _NOTHING:
        special = Interpreter._nothing  # noqa: SLF001 (of this module)
    elif kind.startswith("prim::"):
        special = getattr(Interpreter, "_" + kind.removeprefix("prim::").lower(), None)
    of_type = outputs[0].type().kind() if outputs else ""
    is_value = kind == "prim::Constant" and of_type != "FunctionType"
    name = str(inputs[0].type()) if kind == "prim::CallFunction" else ""
    return _Node(
        kind,
        overload_of(node),
        tuple(each.debugName() for each in inputs),
        tuple(each.debugName() for each in outputs),
        special,
        outputs[0].toIValue() if is_value else None,
        node.s("name") if node.hasAttribute("name") else name,
        of_type == "ClassType",
        tuple(map(_block_of, node.blocks())),
    )


class _Module:
    """A module of the model, by its path."""

    def __init__(self, path: str) -> None:
        self.path = path


def _tensors(value: Anything) -> list[torch.Tensor]:
    if isinstance(value, list | tuple):
        return [tensor for each in value for tensor in _tensors(each)]
    return [value] if isinstance(value, torch.Tensor) else []


def _has_tensor(value: Anything) -> bool:
    return bool(_tensors(value))
