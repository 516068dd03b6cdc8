# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Types and numbers of TorchScript as C++ spells them."""

import math

from terrain_estimator.compiled.graphs import Type, UntranslatableError


def number(value: float) -> str:
    """Return a double as a C++ literal that gives its bytes again."""
    if math.isnan(value):
        return "elementary::kNaN"
    if math.isinf(value):
        return "elementary::kInfinity" if value > 0 else "(-elementary::kInfinity)"
    return repr(float(value)) if value >= 0 else f"({float(value)!r})"


def type_of(kind: Type) -> str:
    """Return the C++ type of a TorchScript type."""
    name = kind.kind()
    simple = {
        "TensorType": "Tensor", "IntType": "int64_t", "FloatType": "double", "BoolType": "bool",
        "NoneType": "std::nullopt_t", "StringType": "const char*",
    }  # fmt: skip
    if name in simple:
        return simple[name]
    if name == "TupleType":
        return f"std::tuple<{', '.join(type_of(e) for e in kind.elements())}>"
    if name == "ListType":
        own = kind.getElementType()
        return "Integers" if own.kind() == "IntType" else f"List<{type_of(own)}>"
    if name == "DictType":
        return f"Dictionary<{type_of(kind.getValueType())}>"
    if name == "OptionalType":
        own = kind.getElementType()
        # a tensor may be undefined
        return "Tensor" if own.kind() == "TensorType" else f"std::optional<{type_of(own)}>"
    raise UntranslatableError(f"a value has the type {kind}")


def literal(value: object) -> str:
    """Return a number of a tuple as a C++ literal of its type."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return f"int64_t{{{value}}}"
    if isinstance(value, float):
        return number(value)
    raise UntranslatableError(f"a tuple with {type(value).__name__} has no C++ form")


def passed(kind: str) -> str:
    """Return the C++ type of a parameter of this type."""
    return kind if kind in ("int64_t", "double", "bool") else f"const {kind}&"
