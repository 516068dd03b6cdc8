# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sequence number of a message without decoding the rest.

Decoding every message would take most of the time of a replay.
"""

import struct

from rosbags.interfaces import Nodetype

from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.definitions import Definition, parse

OURS = "msg_defs/"
_BEGINNING = ((Nodetype.NAME, "std_msgs/msg/Header"), (Nodetype.BASE, ("uint64", 0)))
# [bytes] before the message, and from there to the characters of the header's frame_id
_ENCAPSULATION, _FRAME_ID = 4, 12


def is_sequenced(definition: Definition | None) -> bool:
    """Return whether messages of this definition begin with a header and a sequence number.

    Only types of ``msg_defs`` qualify. The definition is the one that the bag carries.
    """
    if definition is None or not definition.type_name.startswith(OURS):
        return False
    try:
        _, fields = parse(definition.type_name, definition.text)[definition.type_name]
    except BagError:
        return False
    return tuple(kind for _, kind in fields[:2]) == _BEGINNING and fields[1][0] == "sequence"


def sequence_of(data: bytes) -> int | None:
    """Return the sequence number in the CDR of a message that :func:`is_sequenced`.

    None where the message ends before it.
    """
    order = "<" if data[1:2] == b"\1" else ">"
    try:
        (length,) = struct.unpack_from(f"{order}I", data, _ENCAPSULATION + _FRAME_ID - 4)
        at = -(-(_FRAME_ID + length) // 8) * 8  # CDR aligns an uint64 to 8 bytes
        (sequence,) = struct.unpack_from(f"{order}Q", data, _ENCAPSULATION + at)
    except struct.error:
        return None
    return int(sequence)
