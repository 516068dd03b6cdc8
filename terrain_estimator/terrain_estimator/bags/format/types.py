# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Message classes from definitions, without ROS: make, serialise, deserialise."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.serde import SerdeError
from rosbags.typesys.base import TypesysError
from rosbags.typesys.store import Typestore

from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.definitions import Definition, installed_definition, parse

Message = Any  # a dataclass made at run time: its attributes are the message's fields
_CONVERT: dict[str, Callable[..., Any]] = {
    "string": str,
    "bool": bool,
    "float32": float,
    "float64": float,
}
_NUMPY_NAME = {"bool": "bool", "byte": "uint8", "char": "uint8", "octet": "uint8"}


class Types:
    """A set of message types that converts between objects and CDR bytes.

    Attribute names are those of rclpy's classes, so code that reads messages works with both.
    """

    def __init__(self) -> None:
        """Start without types."""
        self._store = Typestore()
        self._plans: dict[
            str, tuple[type[Any], dict[str, Callable[[], Any]], dict[str, Callable[[Any], Any]]]
        ] = {}

    def add(self, definition: Definition) -> None:
        """Add a type and those that it uses.

        Raises:
            BagError: it does not parse, lacks a type that it uses, or another definition of the
                same name is there already.
        """
        try:
            self._store.register(parse(definition.type_name, definition.text))
            self._store.get_msgdef(definition.type_name)
        except KeyError as error:
            msg = (
                f"the definition of {definition.type_name} lacks {error}, which it uses; record the"
                " bag again"
            )
            raise BagError(msg) from error
        except TypesysError as error:
            msg = (
                f"{definition.type_name}: two different definitions in one bag ({error}); record"
                " with one version of the messages"
            )
            raise BagError(msg) from error

    def make(self, type_name: str, **fields: object) -> Message:
        """Build a message; fields not given are zero, empty or default nested messages.

        A type that was not added before is taken from the sourced workspace.

        Raises:
            BagError: the type is not installed, or has no field of that name.
        """
        cls, defaults, converters = self._plan(type_name)
        values = {
            name: converters[name](fields.pop(name)) if name in fields else default()
            for name, default in defaults.items()
        }
        if fields:
            msg = (
                f"{type_name} has no field {', '.join(map(repr, fields))}: it has"
                f" {', '.join(defaults)}"
            )
            raise BagError(msg)
        return cls(**values)

    def serialize(self, message: Message) -> bytes:
        """Return the CDR bytes, little-endian, padding zero."""
        return bytes(self._store.serialize_cdr(message, message.__msgtype__, little_endian=True))

    def deserialize(self, data: bytes, type_name: str) -> Message:
        """Return the message in CDR bytes.

        Raises:
            BagError: the bytes are not such a message.
        """
        try:
            return self._store.deserialize_cdr(data, type_name)
        except (SerdeError, AssertionError, IndexError) as error:
            msg = f"{len(data)} bytes are not a {type_name} ({error})"
            raise BagError(msg) from error

    def _plan(
        self, type_name: str
    ) -> tuple[type[Any], dict[str, Callable[[], Any]], dict[str, Callable[[Any], Any]]]:
        plan = self._plans.get(type_name)
        if plan is None:
            if type_name not in self._store.types:
                self.add(installed_definition(type_name))
            fields = self._store.fielddefs[type_name][1]
            defaults = {name: self._default(field) for name, field in fields}
            plan = (
                self._store.types[type_name],
                defaults,
                {name: _converter(field) for name, field in fields},
            )
            self._plans[type_name] = plan
        return plan

    def _default(self, field: FieldDesc) -> Callable[[], Any]:
        if field[0] == Nodetype.BASE:
            zero: Any = _CONVERT.get(field[1][0], int)()
            return lambda: zero
        if field[0] == Nodetype.NAME:
            name = field[1]
            return lambda: self.make(name)
        element, length = field[1]
        count = length if field[0] == Nodetype.ARRAY else 0
        if dtype := _dtype(element):
            return lambda: np.zeros(count, dtype)
        make = self._default(element)
        return lambda: [make() for _ in range(count)]


def _converter(field: FieldDesc) -> Callable[[Any], Any]:
    if field[0] == Nodetype.BASE:
        return _CONVERT.get(field[1][0], int)
    if field[0] == Nodetype.NAME:
        return lambda value: value
    if dtype := _dtype(field[1][0]):
        return lambda values: np.asarray(values, dtype=dtype)
    return _as_list


def _as_list(values: Sequence[Any]) -> list[Any]:
    return list(values)


def _dtype(element: FieldDesc) -> np.dtype[Any] | None:
    if element[0] != Nodetype.BASE or element[1][0] == "string":
        return None
    return np.dtype(_NUMPY_NAME.get(element[1][0], element[1][0]))
