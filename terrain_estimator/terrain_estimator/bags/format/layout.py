# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Layout of messages that differ in their numbers alone: equal texts, arrays of equal length.

All numbers of such messages lie at the same places of their CDR bytes, so that many messages are
read at once as one structured array.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

LARGEST = 1 << 14
"""[bytes] of a message that is worth a layout."""
_HEAD, _COUNT = 4, 4  # bytes of the encapsulation, and of a length
_NUMPY_NAME = {"bool": "u1", "byte": "uint8", "char": "uint8", "octet": "uint8"}

Definitions = Mapping[str, tuple[Any, Sequence[tuple[str, FieldDesc]]]]
"""Fields of each type, by its name."""


class Layout:
    """Places of the numbers in the CDR bytes of one message and of all that fit it."""

    def __init__(self, data: bytes, walk: "_Walk", example: Any) -> None:  # noqa: ANN401 - a message
        """Take what a walk through the bytes of ``example`` found."""
        self.example = example
        """The message itself."""
        names, formats, offsets = zip(*walk.numbers, strict=True)
        self.dtype = np.dtype(
            {"names": names, "formats": formats, "offsets": offsets, "itemsize": len(data)}
        )
        self._places = np.concatenate([np.arange(first, end) for first, end in walk.fixed])
        self._fixed = np.frombuffer(data, np.uint8)[self._places]

    @classmethod
    def of(
        cls, data: bytes, type_name: str, definitions: Definitions, decode: Callable[[bytes], Any]
    ) -> "Layout | None":
        """Return the layout of a message that ``decode`` takes; None where it has none.

        It is tried on other numbers: a layout that disagrees with ``decode`` is none.
        """
        if len(data) > LARGEST:
            return None
        walk = _Walk(data, definitions)
        try:
            walk.message(type_name, "")
            layout = cls(data, walk, decode(data))
            return layout if layout._agrees(data, decode) else None
        except Exception:  # noqa: BLE001 - what decoding raises depends on the definition
            return None

    def rows(self, messages: Sequence[bytes]) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
        """Return the numbers of n messages of this length [n], and which of them fit [n]."""
        joined = b"".join(messages)
        bytes_of = np.frombuffer(joined, np.uint8).reshape(len(messages), self.dtype.itemsize)
        fits = (bytes_of.take(self._places, axis=1) == self._fixed).all(axis=1)
        return np.frombuffer(joined, self.dtype), fits

    def _agrees(self, data: bytes, decode: Callable[[bytes], Any]) -> bool:
        """Return whether ``decode`` finds numbers that were put to the places of the layout."""
        changed = np.frombuffer(bytearray(data), self.dtype)
        draw = np.random.default_rng(0)
        for name in self.dtype.names or ():
            changed[name] = draw.integers(2, 100, changed[name].shape)
        message = decode(changed.tobytes())
        read = {name: np.asarray(_value(message, name)) for name in self.dtype.names or ()}
        return all(
            np.array_equal(value, changed[name][0].astype(value.dtype))
            for name, value in read.items()
        )


class _Walk:
    """A walk through the bytes of one message, in the order of its fields."""

    def __init__(self, data: bytes, definitions: Definitions) -> None:
        self._data, self._definitions = data, definitions
        self._order: Literal["<", ">"] = "<" if data[1] else ">"
        self._at = _HEAD
        self.numbers: list[tuple[str, tuple[np.dtype[Any], tuple[int, ...]], int]] = []
        self.fixed = [(0, _HEAD)]

    def message(self, type_name: str, prefix: str) -> None:
        """Walk through the fields of a message."""
        for name, field in self._definitions[type_name][1]:
            self._field(field, prefix + name)

    def _field(self, field: FieldDesc, path: str) -> None:
        if field[0] == Nodetype.NAME:
            self.message(field[1], f"{path}.")
        elif field[0] == Nodetype.BASE:
            self._number(field[1][0], (), path)
        else:
            element, length = field[1]
            count = length if field[0] == Nodetype.ARRAY else self._length()
            if element[0] == Nodetype.BASE and element[1][0] != "string":
                if count:
                    self._number(element[1][0], (count,), path)
            else:
                for index in range(count):
                    self._field(element, f"{path}.{index}")

    def _number(self, kind: str, shape: tuple[int, ...], path: str) -> None:
        if kind == "string":
            characters = self._length()
            self._keep(characters)
            return
        dtype = np.dtype(_NUMPY_NAME.get(kind, kind)).newbyteorder(self._order)
        self._align(dtype.itemsize)
        self.numbers.append((path, (dtype, shape), self._at))
        self._at += dtype.itemsize * int(np.prod(shape))

    def _length(self) -> int:
        """Return a number of elements or characters, which is the same in all messages."""
        self._align(_COUNT)
        at = self._at
        self._keep(_COUNT)
        return int(np.frombuffer(self._data, f"{self._order}u4", 1, at)[0])

    def _keep(self, size: int) -> None:
        self.fixed.append((self._at, self._at + size))
        self._at += size

    def _align(self, size: int) -> None:
        self._at += (_HEAD - self._at) % size


def _value(message: Any, path: str) -> Any:  # noqa: ANN401 - any number of a message
    for name in path.split("."):
        message = message[int(name)] if name.isdecimal() else getattr(message, name)
    return message
