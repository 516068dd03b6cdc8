# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Text from messages and files, made safe for a terminal or a log.

A terminal obeys control characters: they can move the cursor, overwrite earlier lines, set the
title or answer as if typed. Bidirectional overrides show a text in another order than it is.
"""

import re

_OBEYED = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # C0 without tab and line feed, DEL, C1
    "\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069"  # order of writing, separators of lines
    "\ud800-\udfff]"  # surrogates cannot be written at all
)


def printable(text: str) -> str:
    r"""Replace every character that a terminal obeys by its escape: ESC becomes ``\x1b``.

    Tabs and line feeds stay. The result does not change if it is treated again.
    """
    return _OBEYED.sub(_escaped, text)


def printable_line(text: str) -> str:
    r"""Do the same to a text that has to stay in one line: a line feed becomes ``\n``."""
    return printable(text).replace("\n", r"\n")


def _escaped(match: re.Match[str]) -> str:
    return match.group().encode("unicode_escape").decode("ascii")
