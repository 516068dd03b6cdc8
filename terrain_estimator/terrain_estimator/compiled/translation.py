# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Plain C++ from the graphs of a TorchScript model: one function for each of its functions.

Branches and loops are kept as they are, so every path of the model is in the C++, and its tensors
have the sizes that they have in torch. An operator without a C++ form is refused by name.
"""

from collections.abc import Iterable

import torch

from terrain_estimator.compiled.graphs import (
    Block,
    Graph,
    Graphs,
    Node,
    UntranslatableError,
    Value,
    joined,
    overload_of,
)
from terrain_estimator.compiled.operators import LIBRARY, WRITERS
from terrain_estimator.compiled.spelling import literal, passed, type_of

IGNORED = ("prim::device", "prim::layout", "prim::Print")
INLINE = ("prim::Constant", "prim::GetAttr", "prim::TupleIndex", "prim::dtype")
"""Operators that are written where they are used: they cost nothing and have no effect."""
BY_NAME = frozenset(
    {
        "aten::__getitem__.Dict_str",
        "aten::_set_item.str",
        "aten::__contains__.str",
    }
)
"""Operators whose second argument is a key of a dictionary."""


class Translation:
    """The C++ of a model's methods and of all that they call."""

    def __init__(self, graphs: Graphs) -> None:
        """Take a model's graphs; nothing is translated yet."""
        self._graphs = graphs
        self.constants: dict[str, tuple[torch.Tensor, str]] = {}  # by name: value, kind
        self.keys: dict[str, int] = {}
        self.declarations: list[str] = []
        self.heads: dict[str, str] = {}
        self.functions: dict[str, str] = {}  # bodies
        self.used: set[str] = set()  # operators
        self._open: set[str] = set()

    def key(self, name: str) -> str:
        """Return the C++ name of a dictionary's key."""
        self.keys.setdefault(name, len(self.keys))
        return f"key::{name}"

    def method(self, name: str, path: str = "") -> str:
        """Translate a method of the module at ``path``, and return its C++ name."""
        own, graph = self._graphs.method(path, name)
        return self._function(own, graph, path)

    def free_function(self, qualified: str) -> str:
        """Translate a function by its qualified name, and return its C++ name."""
        short, graph = self._graphs.function(qualified)
        return self._function(short, graph, None)

    def constant(self, name: str, value: torch.Tensor) -> str:
        """Keep a tensor of the model, and return its C++ name."""
        kinds = {
            torch.float64: "kReal", torch.float32: "kSingle", torch.int64: "kInteger",
            torch.bool: "kBoolean",
        }  # fmt: skip
        if value.dtype not in kinds:
            raise UntranslatableError(f"{name} has the dtype {value.dtype}")
        self.constants[name] = (value.detach(), kinds[value.dtype])
        return f"constants().{name}"

    def attribute(self, path: str, name: str) -> object:
        """Return an attribute of the module at ``path``."""
        return self._graphs.attribute(path, name)

    def _function(self, name: str, graph: Graph, path: str | None) -> str:
        if name not in self._open:
            self._open.add(name)
            head, body = Body(self, name, graph, path).text()
            self.declarations.append(head + ";")
            self.heads[name], self.functions[name] = head, body
        return name


class Body:
    """The C++ of one function."""

    def __init__(self, translation: Translation, name: str, graph: Graph, path: str | None) -> None:
        self._to, self._name, self._graph = translation, name, graph
        self._names: dict[str, str | None] = {}  # expression of each value; None: Python's None
        self._modules: dict[str, str] = {}  # path of each value that is a module
        self._lines: list[str] = []
        self._depth = 1
        self._taken: set[str] = set()
        # a tensor that is written to must be read before
        self._writes = "aten::copy_" in str(graph)
        if path is not None:
            self._modules[next(iter(graph.inputs())).debugName()] = path

    def text(self) -> tuple[str, str]:
        """Return head and body."""
        inputs = [v for v in self._graph.inputs() if v.debugName() not in self._modules]
        parameters = ", ".join(f"{passed(type_of(v.type()))} {self._new(v)}" for v in inputs)
        self._block(self._graph.nodes())
        outputs = [self._use(v) or "std::nullopt" for v in self._graph.outputs()]
        self._emit(f"return {outputs[0]};")
        result = type_of(next(iter(self._graph.outputs())).type())
        return f"{result} {self._name}({parameters})", "".join(self._lines)

    def _emit(self, line: str) -> None:
        self._lines.append("  " * self._depth + line + "\n")

    def _new(self, value: Value) -> str:
        """Return a new C++ name for a value."""
        stem = "".join(c if c.isalnum() else "_" for c in value.debugName())
        # no word of C++ and no function of the runtime ends like this
        name = (f"v{stem}" if stem[0].isdigit() else stem) + "_"
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        self._names[value.debugName()] = name
        return name

    def _use(self, value: Value) -> str | None:
        return self._names[value.debugName()]

    def _block(self, nodes: Iterable[Node]) -> None:
        for node in nodes:
            self._node(node)

    def _node(self, node: Node) -> None:
        kind = node.kind()
        special = getattr(self, "_" + kind.split("::")[1].lower(), None)
        if kind in IGNORED:
            for output in node.outputs():
                self._names[output.debugName()] = None
        elif kind.startswith("prim::") and special is not None:
            special(node)
        else:
            self._operator(node)

    def _operator(self, node: Node) -> None:
        kind = node.kind()
        overload = overload_of(node)
        writer = WRITERS.get(overload)
        self._to.used.add(overload)
        if writer is None:
            raise UntranslatableError(f"the operator {overload} has no C++ form (in {self._name})")
        arguments = [self._use(v) for v in node.inputs()]
        if overload in BY_NAME:
            arguments[1] = self._key(arguments[1])
        try:
            expression = writer(*arguments)
        except (TypeError, ValueError) as error:
            raise UntranslatableError(f"{overload}: {error} (in {self._name})") from None
        if not expression:
            raise UntranslatableError(f"{overload} with {arguments} has no C++ form")
        outputs = list(node.outputs())
        if overload == "aten::mul.Tensor" and self._is_summed(outputs[0]):
            self._names[outputs[0].debugName()] = f"Product{{{', '.join(map(str, arguments))}}}"
        elif kind in INLINE:
            self._names[outputs[0].debugName()] = expression
        elif not outputs or kind in ("aten::copy_", "aten::append"):
            self._emit(f"{expression};")
            for output in outputs:
                self._names[output.debugName()] = arguments[0]
        elif len(outputs) == 1:
            self._let(node, expression)
        else:
            names = ", ".join(self._new(v) for v in outputs)
            self._emit(f"const auto [{names}] = {expression};")

    def _is_summed(self, product: Value) -> bool:
        """Return whether a product is summed right away and nothing else."""
        users = [use.user for use in product.uses()]
        return len(users) == 1 and users[0].kind() == "aten::sum" and not self._writes

    def _key(self, expression: str | None) -> str:
        """Return a dictionary's key, given as an integer or as a string's literal."""
        text = str(expression)
        return self._to.key(text.strip('"')) if text.startswith('"') else text

    def _let(self, node: Node, expression: str) -> None:
        output = next(iter(node.outputs()))
        self._emit(f"const {type_of(output.type())} {self._new(output)} = {expression};")

    # ---- what is not an operator

    def _constant(self, node: Node) -> None:
        output = next(iter(node.outputs()))
        name = output.debugName()
        kind = output.type().kind()
        if kind == "FunctionType":
            self._names[name] = None
            return
        value = output.toIValue()
        if isinstance(value, torch.Tensor):
            self._names[name] = self._to.constant(f"{self._name}_{len(self._to.constants)}", value)
        else:
            self._names[name] = self._literal(value)

    def _literal(self, value: object) -> str | None:
        if value is None or isinstance(value, torch.device):
            return None
        if isinstance(value, int) and not isinstance(value, bool):
            return str(value)
        if isinstance(value, bool | float):
            return literal(value)
        if isinstance(value, str):
            return f'"{value}"'
        if isinstance(value, list) and all(type(v) is int for v in value):
            return f"Integers{{{', '.join(map(str, value))}}}"
        if not isinstance(value, tuple):
            raise UntranslatableError(f"a constant of {type(value).__name__} has no C++ form")
        return f"std::make_tuple({', '.join(literal(v) for v in value)})"

    def _getattr(self, node: Node) -> None:
        output, name = next(iter(node.outputs())), node.s("name")
        source = next(iter(node.inputs())).debugName()
        path = self._modules[source]
        if output.type().kind() == "ClassType":
            self._modules[output.debugName()] = joined(path, name)
            return
        value = self._to.attribute(path, name)
        whole = joined(path, name).replace(".", "_")
        self._names[output.debugName()] = (
            self._to.constant(whole, value)
            if isinstance(value, torch.Tensor)
            else self._literal(value)
        )

    def _callmethod(self, node: Node) -> None:
        own, *arguments = node.inputs()
        name = self._to.method(node.s("name"), self._modules[own.debugName()])
        self._let(node, self._called(name, arguments))

    def _callfunction(self, node: Node) -> None:
        function, *arguments = node.inputs()
        qualified = str(function.type())
        if qualified.startswith("__torch__.torch."):
            writer = LIBRARY.get(qualified.removeprefix("__torch__."))
            if writer is None:
                raise UntranslatableError(f"{qualified} has no C++ form (in {self._name})")
            self._let(node, writer(*map(self._use, arguments)))
        else:
            self._let(node, self._called(self._to.free_function(qualified), arguments))

    def _called(self, name: str, arguments: list[Value]) -> str:
        written = [
            self._use(v) or ("Tensor()" if v.type().kind() == "TensorType" else "{}")
            for v in arguments
        ]
        return f"{name}({', '.join(written)})"

    def _tupleconstruct(self, node: Node) -> None:
        output = next(iter(node.outputs()))
        written = [self._use(v) or "{}" for v in node.inputs()]
        self._let(node, f"{type_of(output.type())}({', '.join(written)})")

    def _tupleindex(self, node: Node) -> None:
        source, place = node.inputs()
        self._names[next(iter(node.outputs())).debugName()] = (
            f"std::get<{self._use(place)}>({self._use(source)})"
        )

    def _tupleunpack(self, node: Node) -> None:
        source = self._use(next(iter(node.inputs())))
        for place, output in enumerate(node.outputs()):
            self._names[output.debugName()] = f"std::get<{place}>({source})"

    def _listconstruct(self, node: Node) -> None:
        output = next(iter(node.outputs()))
        items = ", ".join(self._use(v) or "Tensor()" for v in node.inputs())
        users = {use.user.kind() for use in output.uses()}
        kind = type_of(output.type())
        if kind == "Integers":
            self._names[output.debugName()] = f"Integers{{{items}}}"
        elif items and users <= {"aten::cat", "aten::stack", "aten::index"}:
            self._names[output.debugName()] = f"{{{items}}}"
        else:
            self._let(node, f"{kind}{{{items}}}")

    def _listunpack(self, node: Node) -> None:
        source = self._use(next(iter(node.inputs())))
        for place, output in enumerate(node.outputs()):
            kind = type_of(output.type())
            self._emit(f"const {kind} {self._new(output)} = {source}[{place}];")

    def _dictconstruct(self, node: Node) -> None:
        output = next(iter(node.outputs()))
        items = list(node.inputs())
        pairs = [
            f"{{{self._key(self._use(key))}, {self._use(value)}}}"
            for key, value in zip(items[::2], items[1::2], strict=True)
        ]
        self._let(node, f"{type_of(output.type())}{{{', '.join(pairs)}}}")

    def _unchecked_cast(self, node: Node) -> None:
        source, output = next(iter(node.inputs())), next(iter(node.outputs()))
        optional = source.type().kind() == "OptionalType" and type_of(output.type()) != "Tensor"
        self._names[output.debugName()] = (
            f"(*{self._use(source)})" if optional else self._use(source)
        )

    def _uninitialized(self, node: Node) -> None:
        output = next(iter(node.outputs()))
        self._emit(f"const {type_of(output.type())} {self._new(output)}{{}};")

    def _raiseexception(self, node: Node) -> None:
        message = self._use(next(iter(node.inputs())))
        self._emit(f"fail({message or 'nullptr'});")

    def _if(self, node: Node) -> None:
        condition = self._use(next(iter(node.inputs())))
        outputs = list(node.outputs())
        targets = []
        for output in outputs:
            kind = type_of(output.type())
            targets.append(self._new(output))
            self._emit(f"{kind} {targets[-1]}{{}};")
        yes, no = node.blocks()
        self._emit(f"if ({condition}) {{")
        self._inner(yes, targets)
        self._emit("} else {")
        self._inner(no, targets)
        self._emit("}")

    def _inner(self, block: Block, targets: list[str]) -> None:
        """Write a block whose results go to ``targets``."""
        self._depth += 1
        self._block(block.nodes())
        results = [self._use(v) for v in block.outputs()]
        for target, result in zip(targets, results, strict=True):
            self._emit(f"{target} = {result};" if result is not None else f"{target} = {{}};")
        self._depth -= 1

    def _loop(self, node: Node) -> None:
        most, goes, *carried = node.inputs()
        targets = []
        for before, after in zip(carried, node.outputs(), strict=True):
            targets.append(self._new(after))
            kind = type_of(after.type())
            self._emit(f"{kind} {targets[-1]} = {self._use(before) or '{}'};")
        (block,) = node.blocks()
        count, *inside = block.inputs()
        going = f"going_{self._new(count)}"
        self._emit(f"bool {going} = {self._use(goes)};")
        counter = self._use(count)
        self._emit(
            f"for (int64_t {counter} = 0; {going} && {counter} < {self._use(most)}; ++{counter}) {{"
        )
        for value, target in zip(inside, targets, strict=True):
            self._depth += 1
            self._emit(f"const {type_of(value.type())} {self._new(value)} = {target};")
            self._depth -= 1
        self._inner(block, [going, *targets])
        self._emit("}")
