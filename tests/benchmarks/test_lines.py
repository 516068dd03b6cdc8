# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The table of make bench: bars, written lines, and the other lines after a failure."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

import benchmarks.__main__ as bench
from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.machine import machine
from benchmarks.page import page


def line(value: float, bar: float | None, *, least: bool = False) -> BenchmarkLine:
    return BenchmarkLine("speed", value, "Hz", bar, least=least, reference="loops", against=4.0)


def test_a_bar_is_met_on_its_side_and_never_by_what_was_not_measured() -> None:
    assert line(8.0, 9.0).met
    assert not line(8.0, 7.0).met
    assert line(8.0, 7.0, least=True).met
    assert not line(8.0, 9.0, least=True).met
    assert line(8.0, None).met
    for least in (True, False):
        assert not line(math.nan, 7.0, least=least).met
    assert line(8.0, 9.0).ratio == 2.0


def test_a_failing_benchmark_misses_its_bar_and_the_others_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: Effort) -> Iterator[BenchmarkLine]:
        yield line(8.0, 9.0)
        raise RuntimeError("no DDS here")

    modules = {"rate": broken, "reading": lambda _: [line(1.0, 2.0)]}
    monkeypatch.setattr(
        "benchmarks.__main__.importlib.import_module",
        lambda name: SimpleNamespace(lines=modules[name.rpartition(".")[2]]),
    )
    monkeypatch.chdir(tmp_path)
    assert bench.main(["--only", "rate", "reading"]) == 1
    written = json.loads((tmp_path / "out/bench.json").read_text(encoding="utf-8"))
    assert [(each["value"], each["met"]) for each in written["lines"]] == [
        (8.0, True),
        (None, False),
        (1.0, True),
    ]
    assert "no DDS here" in written["lines"][1]["note"]
    assert {"processor", "cores", "versions", "commit"} <= set(written["machine"])
    assert not (tmp_path / "docs").exists(), "a part of the table is not published"
    assert bench.main(["--only", "reading"]) == 0


def test_the_page_has_every_line_with_its_reference() -> None:
    where = machine()
    text = page([line(8.0, 9.0), line(math.nan, 7.0), line(300.0, None)], where, bench.NAMES)
    rows = [row for row in text.splitlines() if row.startswith("| speed")]
    assert rows[0] == "| speed | 8 Hz | at most 9 | yes | loops | 4 | 2 |"
    assert "not measured" in rows[1]
    assert "**no**" in rows[1]
    assert rows[2] == "| speed | 300 Hz |  |  | loops | 4 | 75 |"
    assert str(where["processor"]) in text
