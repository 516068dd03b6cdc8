# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of messages in memory, and a small stand-in for a message that is far too large."""

import operator
import sys
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from terrain_estimator.observation import Floats
from terrain_estimator.topics import Message

LARGEST_MESSAGE = 1 << 18
"""[B] Largest message that is kept; 3000 joints fit."""
FIXED_PART = 1000
"""[B] of a message besides its texts and arrays."""
_PLAIN = frozenset({str, float})
_DEEPEST = 5  # parts within parts, as odom.pose.pose.position
_LONGEST_NAME = 100  # characters of a frame that are kept
_PARTS: WeakKeyDictionary[type, tuple[Callable[[Message], Any], ...]] = WeakKeyDictionary()
"""Readers of the texts, lists and arrays of each class, found with its first message.

Every bag brings classes of its own, which go with its reader.
"""


def message_bytes(message: Message) -> int:
    """Return about how much memory a message takes: its texts, lists and arrays."""
    kind = type(message)
    parts = _PARTS.get(kind)
    if parts is None:
        parts = tuple(operator.attrgetter(path) for path in _variable_parts(message, 0))
        _PARTS[kind] = parts
    return FIXED_PART + sum(_value_bytes(read(message)) for read in parts)


def _variable_parts(part: object, depth: int) -> Iterator[str]:
    """Yield the paths of all texts, lists and arrays of a message."""
    for name in _fields(part):
        value = getattr(part, name)
        if isinstance(value, str | list | tuple | array | np.ndarray):
            yield name
        elif depth < _DEEPEST:
            yield from (f"{name}.{path}" for path in _variable_parts(value, depth + 1))


def _fields(part: object) -> Iterable[str]:
    """Return the names of a message's fields, of rclpy's classes or of those read from a bag."""
    if hasattr(part, "get_fields_and_field_types"):
        return list(part.get_fields_and_field_types())
    return getattr(part, "__dataclass_fields__", ())


def _value_bytes(value: Any) -> int:  # noqa: ANN401 - any part of a message
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, list | tuple):
        if _PLAIN.issuperset(map(type, value)):
            return sys.getsizeof(value) + sum(map(sys.getsizeof, value))
        return sys.getsizeof(value) + FIXED_PART * len(value)
    return sys.getsizeof(value)


@dataclass(frozen=True, slots=True)
class Oversized:
    """What is kept of a message that is far too large: its stamp, and the reason.

    It has the parts that are read from wheel_slip and wheel_sinkage, without wheels.
    """

    header: Message
    sequence: int | None
    detail: str
    wheel: tuple[str, ...] = ()
    slip: Floats = field(default_factory=lambda: np.empty(0))
    sinkage: Floats = field(default_factory=lambda: np.empty(0))


def bounded(topic: str, message: Message, most_names: int) -> tuple[Message | Oversized, int]:
    """Return a message, or its stand-in where it is too large or names too many wheels.

    With it goes the number of bytes of what is returned.
    """
    names = len(getattr(message, "wheel", ()))
    size = message_bytes(message)
    if names <= most_names and size <= LARGEST_MESSAGE:
        return message, size
    found = f"{names} wheels" if names > most_names else f"{size / 1e6:.3g} MB"
    header = message.header
    stand_in = Oversized(
        SimpleNamespace(stamp=header.stamp, frame_id=header.frame_id[:_LONGEST_NAME]),
        getattr(message, "sequence", None),
        f"{topic}: a message with {found} is left out",
    )
    return stand_in, message_bytes(stand_in)
