# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Files, tables and numbers from elsewhere: read within limits, or refused at once."""

import csv
import math
import os
import socket
import time
import tracemalloc
from pathlib import Path

import pytest

from rover_parameters.csv_rows import LARGEST_ROW, csv_rows
from rover_parameters.numerals import parse_number
from rover_parameters.printable import printable, printable_line
from rover_parameters.regular_file import open_regular, read_regular


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.3", 0.3),
        (" -1e-3 ", -1e-3),
        (".5", 0.5),
        ("7.", 7.0),
        ("+2E2", 200.0),
        ("1e999", math.inf),
    ],
)
def test_a_decimal_number_is_read(text: str, value: float) -> None:
    assert parse_number(text) == value


def test_not_a_number_is_read_as_such() -> None:
    assert math.isnan(parse_number("NaN"))


@pytest.mark.parametrize(
    "text",
    [
        "0_0.3",
        "\u0663.\u0665",
        "\uff11",
        "",
        ".",
        "0x1p3",
        "1,5",
        "1 2",
        "1e",
        "--1",
        "infinite",
        "\u0131nf",
    ],
)
def test_what_only_python_takes_for_a_number_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no number"):
        parse_number(text)


def test_a_number_is_read_in_linear_time() -> None:
    started = time.process_time()
    for text in ("1" * 1_000_000 + "e", "1" * 1_000_000 + "." + "1" * 1_000_000 + "x"):
        with pytest.raises(ValueError, match="is no number"):
            parse_number(text)
    assert time.process_time() - started < 1.0


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    pipe, link, listener = tmp_path / "pipe", tmp_path / "link", tmp_path / "socket"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(listener))
        for path in (pipe, link, listener, Path("/dev/zero")):
            with pytest.raises(OSError, match="not a regular file"):
                open_regular(path)
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)


def test_a_regular_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path, link = tmp_path / "file", tmp_path / "link"
    path.write_bytes(b"12345")
    link.symlink_to(path)
    assert read_regular(path, 5) == read_regular(link, 5) == b"12345"
    with pytest.raises(OSError, match="it has more than 4 bytes"):
        read_regular(path, 4)


@pytest.mark.parametrize("cell", [b",", b'"\n",', b"1" * 100_000 + b","])
def test_a_row_without_end_is_refused_in_little_memory(cell: bytes, tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    path.write_bytes(b"a,b\n" + cell * (8 * LARGEST_ROW // len(cell)))
    tracemalloc.start()
    try:
        with pytest.raises(csv.Error, match="a row has more than 1048576 characters"):
            list(csv_rows(path))
        assert tracemalloc.get_traced_memory()[1] < 60_000_000
    finally:
        tracemalloc.stop()


def test_rows_are_read_as_spreadsheets_write_them(tmp_path: Path) -> None:
    path = tmp_path / "sheet.csv"
    path.write_bytes(b'\xef\xbb\xbfa;b\r\n1;"x\r\ny"\r\n')
    assert list(csv_rows(path, ";", strict=True)) == [["a", "b"], ["1", "x\r\ny"]]


def test_what_a_terminal_obeys_is_made_visible() -> None:
    hostile = "a\x1b[31m\x07\x9b2J\r\u202eb\u2066\x7f\ud800\tc\nd é 土"
    shown = r"a\x1b[31m\x07\x9b2J\r\u202eb\u2066\x7f\ud800" + "\tc\nd é 土"
    assert printable(hostile) == printable(shown) == shown
    assert printable_line("a\nb") == r"a\nb"
