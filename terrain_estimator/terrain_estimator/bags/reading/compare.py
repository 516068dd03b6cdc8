# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Compare the messages of two topics value by value."""

import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np

from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.types import Message
from terrain_estimator.bags.reading.reader import BagReader, RawMessage

Path = str | os.PathLike[str]


@dataclass(frozen=True, slots=True)
class Difference:
    """The first difference between two topics."""

    index: int  # of the message within its topic, from 0
    field: str  # dotted path of the field; "" where one of the topics has no such message
    first: str  # value in the first bag
    second: str

    def __str__(self) -> str:
        """Describe the difference in words."""
        if not self.field:
            return (
                f"message {self.index}: {self.first} in the first bag, {self.second} in the second"
            )
        return (
            f"message {self.index}, {self.field}: {self.first} in the first bag, {self.second} in"
            " the second"
        )


def compare(bag_a: Path, topic_a: str, bag_b: Path, topic_b: str) -> Difference | None:
    """Compare the messages of two topics in the order of their log times.

    Log times themselves are not compared.

    Messages are serialised again first, since the padding of CDR holds arbitrary bytes. NaN equals
    the same NaN.

    Returns:
        The first difference, or None where there is none.

    Raises:
        BagError: a bag is unreadable or lacks its topic.
    """
    with BagReader(bag_a) as reader_a, BagReader(bag_b) as reader_b:
        pairs = zip_longest(_canonical(reader_a, topic_a), _canonical(reader_b, topic_b))
        for index, (first, second) in enumerate(pairs):
            if first is None or second is None:
                return Difference(index, "", _presence(first), _presence(second))
            (bytes_a, type_a, message_a), (bytes_b, type_b, message_b) = first, second
            if type_a != type_b:
                return Difference(index, "type", type_a, type_b)
            if bytes_a != bytes_b:
                return Difference(index, *_first_field(message_a, message_b, ""))
    return None


def _canonical(reader: BagReader, topic: str) -> Iterator[tuple[bytes, str, Message]]:
    if topic not in reader.topics:
        msg = (
            f"{reader.path} has no topic {topic}: it has"
            f" {', '.join(sorted(reader.topics)) or 'none'}"
        )
        raise BagError(msg)
    raw: RawMessage
    for raw in reader.messages([topic]):
        message = reader.decode(raw)
        yield reader.types.serialize(message), raw.type_name, message


def _presence(entry: object) -> str:
    return "missing" if entry is None else "present"


def _first_field(first: Any, second: Any, path: str) -> tuple[str, str, str]:  # noqa: ANN401
    if dataclasses.is_dataclass(first):
        names = [field.name for field in dataclasses.fields(first)]
        parts = [
            (f"{path}.{name}".lstrip("."), getattr(first, name), getattr(second, name))
            for name in names
        ]
    elif isinstance(first, list | np.ndarray) and len(first) == len(second):
        parts = [
            (f"{path}[{index}]", one, other)
            for index, (one, other) in enumerate(zip(first, second, strict=True))
        ]
    else:
        return path, repr(first), repr(second)
    return next(
        (_first_field(one, other, name) for name, one, other in parts if not _same(one, other)),
        (path, "?", "?"),
    )


def _same(first: Any, second: Any) -> bool:  # noqa: ANN401
    if dataclasses.is_dataclass(first):
        return all(
            _same(getattr(first, field.name), getattr(second, field.name))
            for field in dataclasses.fields(first)
        )
    if isinstance(first, np.ndarray):
        return first.tobytes() == np.asarray(second).tobytes()
    if isinstance(first, list):
        return len(first) == len(second) and all(map(_same, first, second))
    if isinstance(first, float):
        return np.float64(first).tobytes() == np.float64(second).tobytes()
    return bool(first == second)
