# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Look up rclpy's message classes by the name of their type, and fill messages fast."""

import array
import importlib
from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from terrain_estimator.topics import Message


def make(type_name: str, **fields: object) -> Message:
    """Return an rclpy message with these fields.

    Lists and NumPy arrays become the arrays that the class takes without a check of every element.
    """
    plan = _plan(type_name)
    converters = plan.converters
    if fields.keys() != plan.setters.keys():
        return plan.kind(
            **{
                name: converters[name](value) if name in converters else value
                for name, value in fields.items()
            }
        )
    # the class would make a default for each part, and copy each array
    message = plan.empty()
    setters = plan.setters
    for name, value in fields.items():
        setters[name](message, converters[name](value) if name in converters else value)
    return message


def message_class(type_name: str) -> type[Any]:
    """Return the class of a type such as ``msg_defs/msg/WheelSlip``."""
    return _plan(type_name).kind


class _Plan(NamedTuple):
    """How the messages of a type are made."""

    kind: type[Any]
    converters: dict[str, Callable[[Any], object]]  # of the fields that are arrays
    setters: dict[str, Callable[[Message, object], None]]  # of all fields; none where it checks

    def empty(self) -> Message:
        """Return a message of which no field is set yet."""
        message: Message = object.__new__(self.kind)
        message._check_fields = False  # noqa: SLF001 - one of the class's own slots
        return message


@cache
def _plan(type_name: str) -> _Plan:
    package, kind, name = type_name.split("/")
    cls = getattr(importlib.import_module(f"{package}.{kind}"), name)
    example = cls()
    names = cls.get_fields_and_field_types()
    converters = {name: _converter(getattr(example, name)) for name in names}
    # ROS_PYTHON_CHECK_FIELDS asks for checks, which are in the class's own setters
    checks = getattr(example, "_check_fields", True)
    return _Plan(
        cls,
        {name: converter for name, converter in converters.items() if converter},
        {} if checks else {name: getattr(cls, f"_{name}").__set__ for name in names},
    )


def _converter(default: object) -> Callable[[Any], object] | None:
    """Return what makes a value of the kind of a field's default; None where any value is one."""
    if isinstance(default, np.ndarray):
        return partial(np.array, dtype=default.dtype)
    if isinstance(default, array.array):
        if default.typecode == "b":  # a grid of a million cells: bytes are not looked at singly
            return lambda values: array.array("b", np.asarray(values, dtype=np.int8).tobytes())
        return partial(array.array, default.typecode)
    return list if isinstance(default, list) else None
