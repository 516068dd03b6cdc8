# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The graphs of a TorchScript model, by the names that its functions have in C++."""

from typing import Any

import torch

# torch has no types for its graphs
Module = Any
Graph = Any
Block = Any
Node = Any
Value = Any
Type = Any
Anything = Any


class UntranslatableError(ValueError):
    """The model holds something that has no C++ form; the text names it."""


def joined(path: str, name: str) -> str:
    """Return the path of what is called ``name`` in the module at ``path``."""
    return f"{path}.{name}" if path else name


def overload_of(node: Node) -> str:
    """Return an operator's name with that of its overload."""
    schema: str = node.schema()
    return schema.split("(", 1)[0] if schema != "(no schema)" else str(node.kind())


def read_for_translation(archive: bytes) -> torch.jit.ScriptModule:
    """Return a checked TorchScript archive's module, with its functions within reach."""
    unit: Module = torch._C.CompilationUnit()  # noqa: SLF001
    read: Module = torch._C.import_ir_module_from_buffer  # noqa: SLF001
    wrap: Module = torch.jit._recursive.wrap_cpp_module  # noqa: SLF001
    loaded = read(unit, archive, torch.device("cpu"), {}, False)  # noqa: FBT003
    module: torch.jit.ScriptModule = wrap(loaded)
    object.__setattr__(module, "_compilation_unit", unit)
    return module


class Graphs:
    """The graphs of a model's methods and functions, and its attributes."""

    def __init__(self, module: torch.jit.ScriptModule) -> None:
        """Take a model of :func:`read_for_translation`."""
        self._module = module._c  # noqa: SLF001 (torch shows its graphs nowhere else)
        # the unit that holds the model's functions; torch keeps it from loaded models
        self._unit: Module = getattr(module, "_compilation_unit", None)
        if self._unit is None:
            raise UntranslatableError("read the model with read_for_translation()")
        self._found: dict[str, tuple[Graph, str | None, str]] = {}
        self.decoded: dict[str, Any] = {}  # what an interpreter has read, by C++ name

    def method(self, path: str, name: str) -> tuple[str, Graph]:
        """Return C++ name and graph of a method of the module at ``path``."""
        own = joined(path, name).replace(".", "_")
        if own not in self._found:
            graph = self._at(path)._get_method(name).graph  # noqa: SLF001
            self._found[own] = graph, path, own
        return own, self._found[own][0]

    def function(self, qualified: str) -> tuple[str, Graph]:
        """Return C++ name and graph of a function by its qualified name."""
        short = "_".join(qualified.split(".")[-2:])
        if short not in self._found:
            self._found[short] = self._unit.find_function(qualified).graph, None, qualified
        if self._found[short][2] != qualified:
            raise UntranslatableError(f"{qualified} and {self._found[short][2]} have one name")
        return short, self._found[short][0]

    def by_name(self, name: str) -> tuple[Graph, str | None]:
        """Return the graph of a function that was found, and the path of a method's module."""
        graph, path, _ = self._found[name]
        return graph, path

    def attribute(self, path: str, name: str) -> object:
        """Return an attribute of the module at ``path``."""
        return self._at(path).getattr(name)

    def _at(self, path: str) -> Module:
        module = self._module
        for part in path.split(".") if path else ():
            module = module.getattr(part)
        return module
