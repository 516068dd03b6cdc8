# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: ARG002 (every part of a graph takes the same arguments)
"""Runs the graphs of a TorchScript model one operator at a time, so that one can watch it.

The numbers are torch's own. What is watched decides where the C++ gets a second form for the sizes
and the path that a drive took (``recording``).
"""

import operator
from collections.abc import Callable, Iterable
from typing import Any

import torch

from terrain_estimator.compiled.graphs import Anything, Graph, Graphs, Node, overload_of

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
        values: dict[str, Any] = {}
        inputs = list(graph.inputs())
        if path is not None:
            values[inputs[0].debugName()] = _Module(path)
            inputs = inputs[1:]
        for value, given in zip(inputs, arguments, strict=True):
            values[value.debugName()] = given
        self._block(graph.nodes(), values)
        (output,) = graph.outputs()
        return values[output.debugName()]

    def _block(self, nodes: Iterable[Node], values: dict[str, Any]) -> None:
        for node in nodes:
            given = [values.get(v.debugName()) for v in node.inputs()]
            special = getattr(self, "_" + node.kind().split("::")[1].lower(), None)
            if node.kind() in _NOTHING:
                results: list[Any] = [None]
            elif node.kind().startswith("prim::") and special is not None:
                results = special(node, given, values)
            else:
                results = self._operator(node, given)
            for value, result in zip(node.outputs(), results, strict=True):
                values[value.debugName()] = result

    def _operator(self, node: Node, given: list[Any]) -> list[Any]:
        kind, overload = node.kind(), overload_of(node)
        on_tensors = any(_has_tensor(v) for v in given)
        if kind == "aten::Bool" and on_tensors and self._branch is not None:
            self._branch(given[0])
        elif kind in _TAKEN_OUT and on_tensors and self._watch is not None:
            self._watch(overload, given, [])
        count = len(list(node.outputs()))
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

    def _constant(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        (output,) = node.outputs()
        return [None] if output.type().kind() == "FunctionType" else [output.toIValue()]

    def _getattr(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        (output,) = node.outputs()
        path, name = given[0].path, node.s("name")
        whole = f"{path}.{name}" if path else name
        if output.type().kind() == "ClassType":
            return [_Module(whole)]
        return [self._graphs.attribute(path, name)]

    def _callmethod(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [self.method(given[0].path, node.s("name"), given[1:])]

    def _callfunction(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        qualified = str(next(iter(node.inputs())).type())
        if not qualified.startswith("__torch__.torch."):
            return [self.function(qualified, given[1:])]
        function: Any = torch
        for part in qualified.removeprefix("__torch__.torch.").split("."):
            function = getattr(function, part)
        result = function(*given[1:])
        if self._watch is not None:
            self._watch(qualified.removeprefix("__torch__."), given[1:], [result])
        return [result]

    def _listconstruct(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [list(given)]

    def _tupleconstruct(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [tuple(given)]

    def _dictconstruct(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [dict(zip(given[::2], given[1::2], strict=True))]

    def _listunpack(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return list(given[0])

    def _tupleunpack(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return list(given[0])

    def _tupleindex(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [given[0][given[1]]]

    def _unchecked_cast(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return given

    def _uninitialized(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        return [None]

    def _raiseexception(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        raise RuntimeError(given[0])

    def _if(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        yes, no = node.blocks()
        block = yes if given[0] else no
        self._block(block.nodes(), values)
        return [values[v.debugName()] for v in block.outputs()]

    def _loop(self, node: Node, given: list[Any], values: dict[str, Any]) -> list[Any]:
        most, goes, *carried = given
        (block,) = node.blocks()
        count = 0
        while goes and count < most:
            for value, now in zip(block.inputs(), [count, *carried], strict=True):
                values[value.debugName()] = now
            self._block(block.nodes(), values)
            goes, *carried = [values[v.debugName()] for v in block.outputs()]
            count += 1
        return list(carried)


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
