# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""CDR bytes of messages that nobody else needs: from their fields, without the messages.

Messages whose texts and sequences have the same lengths have their numbers at the same places. So
one format of ``struct`` packs all values of such a message at once.
"""

import operator
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.types import Types

_HEAD = b"\0\1\0\0"  # of little-endian CDR
_COUNT = 4  # bytes of a length, to which it is aligned
_CODES = {
    "bool": "?", "byte": "B", "char": "B", "octet": "B", "int8": "b", "uint8": "B", "int16": "h",
    "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f",
    "float64": "d",
}  # fmt: skip
_NUMBER, _NUMBERS, _TEXT, _TEXTS, _DRAFT, _DRAFTS = range(6)
_MOST = 512
"""Formats, and texts, that are kept."""


class Draft(NamedTuple):
    """The fields of a message that is not made."""

    type_name: str
    fields: Mapping[str, Any]


class _Field(NamedTuple):
    name: str
    kind: int
    of: str  # code of a number, or type of a message
    length: int | None  # of an array


class _Plan:
    """The fields of a type in their order."""

    def __init__(self, type_name: str, fields: tuple[_Field, ...]) -> None:
        self._type_name, self.fields = type_name, fields
        self.kinds = [field.kind for field in fields]
        self._names = [field.name for field in fields]
        # the first one again: of a single name it gives no tuple
        self._pick = operator.itemgetter(*self._names, self._names[0])

    def ordered(self, fields: Mapping[str, Any]) -> Sequence[Any]:
        """Return the values of a draft's fields; raises BagError."""
        try:
            values = self._pick(fields)
        except KeyError:
            values = ()
        if len(values) != len(fields) + 1:
            raise BagError(
                f"{self._type_name} has the fields {', '.join(self._names)}, and is given"
                f" {', '.join(fields)}"
            )
        return values


class Packer:
    """Pack messages of some types."""

    def __init__(self, types: Types, *type_names: str) -> None:
        """Take the definitions of the types, of which those that are named are read at once.

        Raises:
            BagError: one of them is not installed.
        """
        self._types = types
        self._plans: dict[str, _Plan] = {}
        self._formats: dict[tuple[str | int, ...], struct.Struct] = {}
        for type_name in type_names:
            self._learn(type_name)

    def make(self, type_name: str, **fields: object) -> Draft:
        """Return the draft of a message with these fields, which have to be all.

        Raises:
            BagError: the type is not installed.
        """
        if type_name not in self._plans:
            self._learn(type_name)
        return Draft(type_name, fields)

    def pack(self, draft: Draft) -> bytes:
        """Return the bytes that ``Types.serialize`` gives of the message.

        Raises:
            BagError: a field is missing, unknown or of a wrong length.
        """
        key: list[str | int] = [draft.type_name]
        values: list[Any] = [_HEAD]
        self._collect(draft, key, values)
        lengths = tuple(key)
        known = self._formats.get(lengths)
        if known is None:
            known = struct.Struct(self._format(draft.type_name, iter(key[1:])))
            if len(self._formats) >= _MOST:
                self._formats.clear()
            self._formats[lengths] = known
        return known.pack(*values)

    def _collect(self, draft: Draft, key: list[str | int], values: list[Any]) -> None:
        """Add all values in order, and the lengths on which their places depend."""
        type_name, fields = draft
        plan = self._plans[type_name]
        for kind, value, field in zip(plan.kinds, plan.ordered(fields), plan.fields, strict=False):
            if kind == _NUMBER:
                values.append(value)
            elif kind == _TEXT:
                block = _text(value)
                key.append(len(block))
                values.append(block)
            elif kind == _DRAFT:
                self._collect(value, key, values)
            else:
                self._collect_many(field, value, key, values)

    def _collect_many(
        self, field: _Field, value: Sequence[Any], key: list[str | int], values: list[Any]
    ) -> None:
        count, length, kind = len(value), field.length, field.kind
        if length is not None and count != length:
            raise BagError(f"{field.name} has {count} of {length} values")
        if kind == _TEXTS:
            block = _texts(tuple(value))[0 if length is None else _COUNT :]
            key.append(len(block))
            values.append(block)
            return
        if length is None:
            key.append(count)
            values.append(count)
        if kind == _NUMBERS:
            values.extend(value)
            return
        for each in value:
            self._collect(each, key, values)

    def _format(self, type_name: str, lengths: Iterator[Any]) -> str:
        """Return the format of all values, by their lengths."""
        parts = [f"<{len(_HEAD)}s"]
        at = 0

        def add(code: str, size: int, alignment: int) -> None:
            nonlocal at
            padding = -at % alignment
            parts.append(f"{padding}x{code}" if padding else code)
            at += padding + size

        def message(type_name: str) -> None:
            for _, kind, of, length in self._plans[type_name].fields:
                if kind in (_TEXT, _TEXTS):
                    size = next(lengths)
                    add(f"{size}s", size, _COUNT)
                    continue
                count = 1
                if kind in (_NUMBERS, _DRAFTS):
                    count = next(lengths) if length is None else length
                    if length is None:
                        add("I", _COUNT, _COUNT)
                if kind in (_DRAFT, _DRAFTS):
                    for _ in range(count):
                        message(of)
                elif count:
                    size = struct.calcsize(of)
                    add(f"{count}{of}", count * size, size)

        message(type_name)
        return "".join(parts)

    def _learn(self, type_name: str) -> None:
        """Read the definition of a type and of those that it uses."""
        fields = tuple(_field(name, kind) for name, kind in self._types.fields(type_name))
        self._plans[type_name] = _Plan(type_name, fields)
        for field in fields:
            if field.kind in (_DRAFT, _DRAFTS) and field.of not in self._plans:
                self._learn(field.of)


def _field(name: str, kind: FieldDesc) -> _Field:
    if kind[0] == Nodetype.NAME:
        return _Field(name, _DRAFT, kind[1], None)
    if kind[0] == Nodetype.BASE:
        single = kind[1][0]
        if single == "string":
            return _Field(name, _TEXT, "", None)
        return _Field(name, _NUMBER, _CODES[single], None)
    element, length = kind[1]
    many = _field(name, element)
    kinds = {_NUMBER: _NUMBERS, _TEXT: _TEXTS, _DRAFT: _DRAFTS}
    fixed = length if kind[0] == Nodetype.ARRAY else None
    return many._replace(kind=kinds[many.kind], length=fixed)


@lru_cache(_MOST)
def _text(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack("<I", len(encoded) + 1) + encoded + b"\0"


@lru_cache(_MOST)
def _texts(texts: Sequence[str]) -> bytes:
    """Return a sequence of texts, of which all but the first stand behind padding."""
    block = struct.pack("<I", len(texts))
    for text in texts:
        block += bytes(-len(block) % _COUNT) + _text(text)
    return block
