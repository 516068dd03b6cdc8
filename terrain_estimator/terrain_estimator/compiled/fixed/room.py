# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One room for all buffers that live within a form."""

import re
from collections.abc import Sequence

_APART = 8
"""[numbers] Buffers begin at multiples of it: a line of the cache."""


def packed(sizes: dict[int, int], lines: Sequence[str]) -> tuple[dict[int, int], int]:
    """Return a place for each buffer in one room, and its size: what is not used later makes room.

    ``sizes`` are by the number n of a buffer, which ``lines`` call bn.
    """
    first: dict[int, int] = {}
    last: dict[int, int] = {}
    for at, line in enumerate(lines):
        for found in re.findall(r"\bb(\d+)\b", line):
            first.setdefault(int(found), at)
            last[int(found)] = at
    places: dict[int, int] = {}
    living: list[tuple[int, int, int]] = []  # end of life, first and last number
    room = 0
    for buffer in sorted(sizes, key=lambda b: first.get(b, 0)):
        begin, size = first.get(buffer, 0), -(-max(sizes[buffer], 1) // _APART) * _APART
        living = sorted((each for each in living if each[0] >= begin), key=lambda e: e[1])
        place = 0
        for _, low, high in living:
            if place + size <= low:
                break
            place = max(place, high)
        places[buffer] = place
        living.append((last.get(buffer, 0), place, place + size))
        room = max(room, place + size)
    return places, room
