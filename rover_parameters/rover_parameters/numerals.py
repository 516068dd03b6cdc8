# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers in text files, read strictly.

``float`` of Python also accepts underscores between digits and the digits of other scripts, which
are typing errors or another program's words in a table of measurements.
"""

import re

_NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?(?:nan|inf|infinity)", re.IGNORECASE | re.ASCII)


def parse_number(text: str) -> float:
    """Read a decimal number of ASCII digits, point and exponent; spaces around it are ignored.

    The words nan, inf and infinity are read too, and a number too large gives infinity, so that the
    caller can refuse what is not finite in its own words. The time is linear in the length.

    Raises:
        ValueError: the text is no such number.
    """
    stripped = text.strip()
    if not (_NUMBER.fullmatch(stripped) or _NOT_FINITE.fullmatch(stripped)):
        raise ValueError(f"{stripped[:40]!r} is no number")
    return float(stripped)
