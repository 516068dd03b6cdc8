# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of a CSV file, in memory that does not grow with the file."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from rover_parameters.regular_file import open_regular

LARGEST_ROW = 1 << 20
"""[characters] Largest row, all its lines together."""


def csv_rows(path: Path, delimiter: str = ",", *, strict: bool = False) -> Iterator[list[str]]:
    """Yield the cells of each row, also of empty ones; ``strict`` is that of :mod:`csv`.

    The encoding is UTF-8; a byte order mark, which spreadsheets write, is passed over.

    Raises:
        OSError: the file cannot be read, or is not a regular one.
        UnicodeDecodeError: it is not UTF-8.
        csv.Error: it is not CSV, or a row is longer than ``LARGEST_ROW``.
    """
    with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as file:
        lines = _Lines(file)
        for row in csv.reader(lines, delimiter=delimiter, strict=strict):
            lines.left = LARGEST_ROW
            yield row


class _Lines:
    """Lines of a file; ``left`` is the number of characters that the present row may still have."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self.left = LARGEST_ROW

    def __iter__(self) -> Iterator[str]:
        while line := self._file.readline(self.left + 1):
            self.left -= len(line)
            if self.left < 0:
                raise csv.Error(f"a row has more than {LARGEST_ROW} characters")
            yield line
