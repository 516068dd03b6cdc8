# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Message classes from definitions, without ROS: make, serialise, deserialise."""

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.serde import SerdeError
from rosbags.typesys.base import TypesysError
from rosbags.typesys.store import Typestore

from rover_parameters.records import shortened
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.definitions import Definition, installed_definition, parse
from terrain_estimator.bags.format.layout import Layout

Message = Any  # a dataclass made at run time: its attributes are the message's fields
MOST_OBJECTS = 500_000
"""Largest number of objects that a message may become; one takes up to 200 bytes."""
_ALIGNMENT, MOST_LEFT = 4, 32
"""[bytes] That may be left at the end of a message.

rclpy's serialize_message reckons up to 7 for each empty sequence of numbers of 8 bytes, which it
then does not fill: in a JointState without velocities and efforts, for instance.
"""
_CONVERT: dict[str, Callable[..., Any]] = {
    "string": str,
    "bool": bool,
    "float32": float,
    "float64": float,
}
_LEAST_TEXT, _COUNT = 5, 4  # bytes of an empty text, and of a sequence's number of elements
_NUMPY_NAME = {"bool": "bool", "byte": "uint8", "char": "uint8", "octet": "uint8"}


class _Cost(NamedTuple):
    """Objects that a field becomes, without those in sequences, and the bytes that it has."""

    objects: int
    least_bytes: int
    densest: float  # most objects in a byte of a sequence within


class Types:
    """A set of message types that converts between objects and CDR bytes.

    Attribute names are those of rclpy's classes, so code that reads messages works with both.
    """

    def __init__(self) -> None:
        """Start without types."""
        self._store = Typestore()
        self._densities: dict[str, float] = {}
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
        except BagError:
            raise
        except KeyError as error:
            raise BagError(
                f"the definition of {definition.type_name} lacks {error}, which it uses; record the"
                " bag again"
            ) from error
        except TypesysError as error:
            raise BagError(
                f"{definition.type_name}: two different definitions in one bag ({error}); record"
                " with one version of the messages"
            ) from error
        except Exception as error:  # what the generated code raises depends on the definition
            raise BagError(
                f"no class can be made of the definition of {definition.type_name}"
                f" ({type(error).__name__}: {shortened(str(error))}); record the bag again"
            ) from error

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

    def fields(self, type_name: str) -> Sequence[tuple[str, FieldDesc]]:
        """Return names and kinds of a type's fields in order, as rosbags has them.

        A type that was not added before is taken from the sourced workspace.

        Raises:
            BagError: the type is not installed.
        """
        if type_name not in self._store.types:
            self.add(installed_definition(type_name))
        return self._store.fielddefs[type_name][1]

    def serialize(self, message: Message) -> bytes:
        """Return the CDR bytes, little-endian, padding zero."""
        return bytes(self._store.serialize_cdr(message, message.__msgtype__, little_endian=True))

    def deserialize(self, data: bytes, type_name: str) -> Message:
        """Return the message in CDR bytes.

        Raises:
            BagError: the bytes are not such a message.
        """
        if len(data) * self._objects_per_byte(type_name) > MOST_OBJECTS:
            raise BagError(
                f"a {type_name} of {len(data)} bytes is not decoded: it may become more than"
                f" {MOST_OBJECTS} objects"
            )
        try:
            return self._deserialize(data, type_name)
        except Exception as error:  # what the generated code raises depends on the bytes
            raise BagError(
                f"{len(data)} bytes are not a {type_name} ({shortened(str(error))})"
            ) from error

    def layout(self, data: bytes, type_name: str) -> Layout | None:
        """Return the layout of messages like this one, which :meth:`deserialize` takes.

        None where they are read one by one.
        """
        return Layout.of(
            data,
            type_name,
            self._store.fielddefs,
            lambda changed: self.deserialize(changed, type_name),
        )

    def _deserialize(self, data: bytes, type_name: str) -> Message:
        """Deserialize; where that fails, without bytes that a serializer left at the end."""
        try:
            return self._store.deserialize_cdr(data, type_name)
        except SerdeError as error:
            if "size mismatch" not in str(error):
                raise
            for left in range(_ALIGNMENT, MOST_LEFT + 1, _ALIGNMENT):
                with contextlib.suppress(SerdeError):
                    return self._store.deserialize_cdr(data[:-left], type_name)
            raise

    def _objects_per_byte(self, type_name: str) -> float:
        """Return the largest number of objects in a byte of a sequence within a message."""
        if type_name not in self._densities:
            costs: dict[str, _Cost] = {}
            self._densities[type_name] = self._cost(type_name, costs).densest
        return self._densities[type_name]

    def _cost(self, type_name: str, costs: dict[str, "_Cost"]) -> "_Cost":
        if type_name not in costs and type_name in self._store.fielddefs:
            fields = [
                self._cost_of(field, costs) for _, field in self._store.fielddefs[type_name][1]
            ]
            costs[type_name] = _Cost(
                1 + sum(each.objects for each in fields),
                sum(each.least_bytes for each in fields),
                max((each.densest for each in fields), default=0.0),
            )
        return costs.get(type_name, _Cost(1, 1, 0.0))

    def _cost_of(self, field: FieldDesc, costs: dict[str, "_Cost"]) -> "_Cost":
        if field[0] == Nodetype.NAME:
            return self._cost(field[1], costs)
        if field[0] == Nodetype.BASE:
            return _Cost(1, _LEAST_TEXT if field[1][0] == "string" else 1, 0.0)
        element, length = field[1]
        one = _Cost(0, 1, 0.0) if _dtype(element) else self._cost_of(element, costs)
        if field[0] == Nodetype.ARRAY:
            return _Cost(1 + length * one.objects, length * one.least_bytes, one.densest)
        return _Cost(1, _COUNT, max(one.densest, one.objects / max(one.least_bytes, 1)))

    def _plan(
        self, type_name: str
    ) -> tuple[type[Any], dict[str, Callable[[], Any]], dict[str, Callable[[Any], Any]]]:
        plan = self._plans.get(type_name)
        if plan is None:
            fields = self.fields(type_name)
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
