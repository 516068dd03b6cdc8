# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of a message definition, checked before rosbags generates code from it.

rosbags writes a line of code for every element of a fixed array of texts or messages, and follows
types within types by recursion: 20 bytes of definition could ask for 300 million lines. The text is
checked line by line before it is parsed, the types before they are registered.
"""

import math
import re
from collections.abc import Iterable

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict

from rover_parameters.records import shortened
from terrain_estimator.bags.errors import BagError

LARGEST_TEXT = 1 << 18
"""[bytes] Largest text of a definition with all types that it uses; common ones have up to 2^16."""
LONGEST_LINE = 2000
"""[characters] of a field or constant; a comment may be longer."""
MOST_FIELDS = 5000
"""Largest number of fields and constants of all types together."""
MOST_TYPES = 500
DEEPEST = 40
"""Largest number of types within each other."""
LARGEST_ARRAY = 1_000_000
"""Largest fixed array of numbers, and largest bound of a sequence that is not ignored."""
MOST_PARTS = 20_000
"""Largest number of fields of a message with the types within it written out."""
SEPARATOR = "=" * 80
_TYPE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*/(?:msg|srv|action)/[A-Za-z][A-Za-z0-9_]*")
_HEAD = re.compile(r"MSG: [A-Za-z][A-Za-z0-9_/]*[ \t]*")
_FIELD = re.compile(
    r"[ \t]*(?P<type>[A-Za-z][A-Za-z0-9_/]*(?:<=[0-9]+)?(?:\[(?:<=)?[0-9]*\])?)[ \t]+"
    r"(?P<name>[A-Za-z][A-Za-z0-9_]*)(?P<value>.*)"
)
_DIGITS = re.compile(r"[0-9]+")
_LONGEST_NUMBER = 400  # digits
_REMEDY = "record the bag again, or repair the .msg file"


def check_text(type_name: str, text: str) -> None:
    """Check name and text of a definition, in time proportional to its length.

    Raises:
        BagError: names type, line or field, and value.
    """
    if not _TYPE_NAME.fullmatch(type_name) or len(type_name) > LONGEST_LINE:
        raise BagError(
            f"{shortened(type_name)} is not the name of a message type, such as"
            f" nav_msgs/msg/Odometry: {_REMEDY}"
        )
    where = f"the definition of {type_name}"
    if len(text) > LARGEST_TEXT:
        raise BagError(f"{where} has {len(text)} bytes, more than {LARGEST_TEXT}: {_REMEDY}")
    fields = types = 0
    for number, line in enumerate(text.split("\n"), start=1):
        content = line.partition("#")[0] if "'" not in line and '"' not in line else line
        if not content.strip() or content.lstrip().startswith("#"):
            continue
        if line == SEPARATOR or _HEAD.fullmatch(line):
            types += line == SEPARATOR
        else:
            fields += 1
            _check_line(f"{where}, line {number}", content)
        if fields > MOST_FIELDS or types > MOST_TYPES:
            raise BagError(
                f"{where} has more than {MOST_FIELDS} fields or {MOST_TYPES} types: {_REMEDY}"
            )


def _check_line(where: str, line: str) -> None:
    if len(line) > LONGEST_LINE:
        raise BagError(f"{where} has {len(line)} characters, more than {LONGEST_LINE}: {_REMEDY}")
    match = _FIELD.fullmatch(line)
    if match is None:
        raise BagError(f"{where}, {shortened(line.strip())}, is no field or constant: {_REMEDY}")
    where = f"{where}, field {match['name']}"
    for digits in _DIGITS.findall(line):
        if len(digits) > _LONGEST_NUMBER:
            raise BagError(f"{where}: a number of {len(digits)} digits: {_REMEDY}")
    value = match["value"].strip().removeprefix("=").strip()
    try:
        finite = math.isfinite(float(value)) or value.lower().lstrip("+-") in {"inf", "nan"}
    except ValueError:
        finite = True  # no number: a text, a list or nothing
    if not finite:
        raise BagError(f"{where}: value {shortened(value)} is too large: {_REMEDY}")


def check_types(type_name: str, types: Typesdict, order: Iterable[str]) -> None:
    """Check sizes, nesting and total of the types of a definition.

    Args:
        type_name: of the definition.
        types: all types of it, parsed.
        order: their names, those that a type uses before itself.

    Raises:
        BagError: names type, field and value.
    """
    parts: dict[str, int] = {}
    depths: dict[str, int] = {}
    for name in order:
        if name not in types:  # rosbags reports a type that lacks
            parts[name], depths[name] = 1, 1
            continue
        parts[name] = depths[name] = 1
        for field, description in types[name][1]:
            where = f"the definition of {type_name}: type {name}, field {field}"
            count, depth = _weight(where, description, parts, depths)
            parts[name] += count
            depths[name] = max(depths[name], 1 + depth)
            if parts[name] > MOST_PARTS:
                raise BagError(
                    f"{where}: more than {MOST_PARTS} fields with all types within written out:"
                    f" {_REMEDY}"
                )
            if depths[name] > DEEPEST:
                raise BagError(f"{where}: more than {DEEPEST} types within each other: {_REMEDY}")


def _weight(
    where: str, description: FieldDesc, parts: dict[str, int], depths: dict[str, int]
) -> tuple[int, int]:
    """Return the number of parts and the depth of a field's types."""
    kind = description[0]
    if kind == Nodetype.BASE:
        return 1, 0
    if kind == Nodetype.NAME:
        name = str(description[1])
        return parts[name], depths[name]
    element, size = description[1]
    if kind == Nodetype.ARRAY and not 1 <= size <= LARGEST_ARRAY:
        raise BagError(f"{where}: array of size {size}, not 1 to {LARGEST_ARRAY}: {_REMEDY}")
    count, depth = _weight(where, element, parts, depths)
    if kind == Nodetype.SEQUENCE or (element[0] == Nodetype.BASE and element[1][0] != "string"):
        return count, depth
    return size * count, depth
