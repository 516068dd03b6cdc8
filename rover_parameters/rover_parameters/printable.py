# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Text from messages and files, made safe for a terminal or a log.

A terminal obeys control characters: they can move the cursor, overwrite earlier lines, set the
title or answer as if typed. Bidirectional overrides show a text in another order than it is.
"""

import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TextIO, cast

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


class PrintableStream:
    """A text stream whose writes go through :func:`printable`; otherwise the stream itself."""

    def __init__(self, stream: TextIO) -> None:
        """Write to ``stream``."""
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text; return its length."""
        self.stream.write(printable(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write several texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> object:
        """Return an attribute of the stream."""
        return getattr(self.stream, name)


@contextmanager
def printable_output() -> Iterator[None]:
    """Make all that this process prints to stdout and stderr printable."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast("TextIO", PrintableStream(stream)) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def unguarded(stream: TextIO) -> TextIO:
    """Return the stream that a terminal obeys, for a program that moves the cursor on purpose."""
    return unguarded(stream.stream) if isinstance(stream, PrintableStream) else stream


def _escaped(match: re.Match[str]) -> str:
    return match.group().encode("unicode_escape").decode("ascii")
