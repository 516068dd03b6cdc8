# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Look up rclpy's message classes by the name of their type, and fill messages fast."""

import array
import importlib
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from terrain_estimator.topics import Message

_ARRAY_CODE = {"sequence<double>": "d", "sequence<uint64>": "Q"}


def make(type_name: str, **fields: object) -> Message:
    """Return an rclpy message with these fields.

    Lists and NumPy arrays become the arrays that the class takes without a check of every element.
    """
    cls, converters = _plan(type_name)
    return cls(
        **{
            name: converters[name](value) if name in converters else value
            for name, value in fields.items()
        }
    )


def message_class(type_name: str) -> type[Any]:
    """Return the class of a type such as ``msg_defs/msg/WheelSlip``."""
    return _plan(type_name)[0]


@cache
def _plan(type_name: str) -> tuple[type[Any], dict[str, Callable[[Any], object]]]:
    """Return the class of a type, and the converters of its fields that are arrays."""
    package, kind, name = type_name.split("/")
    cls = getattr(importlib.import_module(f"{package}.{kind}"), name)
    return cls, {
        name: _converter(kind)
        for name, kind in cls.get_fields_and_field_types().items()
        if kind.startswith("sequence<") or "[" in kind
    }


def _converter(kind: str) -> Callable[[Any], object]:
    if kind == "sequence<int8>":  # a grid of a million cells: bytes are not looked at one by one
        return lambda values: array.array("b", np.asarray(values, dtype=np.int8).tobytes())
    code = _ARRAY_CODE.get(kind)
    if code is not None:
        return lambda values: array.array(code, values)
    return list if kind.startswith("sequence<") else np.asarray
