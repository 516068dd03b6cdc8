# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pages that follow from the code, and marks of figures that were measured with another code."""

import subprocess
from pathlib import Path
from string import Formatter

import pytest

import benchmarks.page as benchmarks
import benchmarks.soak.page as soak
import studies.accuracy.table as accuracy
import studies.change.table as change
import studies.foreign_discovery.table as foreign_effect
import studies.independent_reference.table as independent
import studies.long.table as long_drives
import studies.measured.table as wheels
import studies.recursion.table as recursion
import studies.stream.table as stream
import tests.faults.page as faults
import tests.fuzz.__main__ as fuzz
import tests.hidden.judge.page as hidden
from docs import provenance
from docs.pages import FOLDER, MEASURED, PAGES
from docs.provenance import digest, measured, refreshed
from tests.faults import million

PROSE = (
    *(("accuracy", text) for text in (accuracy.INTRODUCTION, accuracy.METHOD, accuracy.REASONS)),
    *(("accuracy_tables", text) for text in (accuracy.TABLES, accuracy.OVER_TIME)),
    *(("accuracy_tables", text) for text in (accuracy.VELOCITY, accuracy.REFERENCE, accuracy.NET)),
    *(("change", text) for text in (change.INTRODUCTION, change.TERMS)),
    *(("stream_study", text) for text in (stream.INTRODUCTION, stream.FORECAST, stream.WHY)),
    *(("long_drives", text) for text in (long_drives.PAGE, long_drives.TERMS)),
    *(("independent_reference", text) for text in (independent.INTRODUCTION, independent.MODEL)),
    *(("measured", text) for text in (wheels.INTRODUCTION, wheels.VERDICTS, wheels.HELD_OUT)),
    *(("measured", text) for text in (wheels.SHARES, wheels.WHEELS, wheels.FREE)),
    ("measured", wheels.STRENGTH),
    *(("recursion", text) for text in (recursion.INTRODUCTION, recursion.LEGEND, recursion.WHY)),
    *(("benchmarks", text) for text in (benchmarks.HEAD, benchmarks.AFTER)),
    *(("faults", text) for text in (faults.MATRIX, million.SECTION, soak.SECTION, fuzz.SECTION)),
    *(("foreign_discovery", text) for text in (foreign_effect.INTRODUCTION, foreign_effect.NAMES)),
    *(("hidden", text) for text in (hidden.INTRODUCTION, hidden.VERDICTS, hidden.ROVER)),
)
"""Pages, and texts of their commands with fields for what was measured."""


@pytest.mark.parametrize("name", PAGES)
def test_a_written_page_is_the_one_that_the_code_writes(name: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == PAGES[name](), "run make pages"


@pytest.mark.parametrize("path", MEASURED, ids=lambda path: path.name)
def test_a_page_marks_figures_whose_code_has_changed_since(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text == refreshed(text), "run make pages"


@pytest.mark.parametrize(("name", "text"), PROSE, ids=[name for name, _ in PROSE])
def test_the_prose_of_a_measured_page_is_the_one_that_its_command_writes(
    name: str, text: str
) -> None:
    page = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert [piece for piece, *_ in Formatter().parse(text) if piece not in page] == []


WRITTEN = (
    "accuracy",
    "benchmarks",
    "change",
    "faults",
    "foreign_discovery",
    "hidden",
    "independent_reference",
    "long_drives",
    "measured",
    "paper",
    "planner",
    "recursion",
    "stream_study",
)


@pytest.mark.parametrize("name", WRITTEN)
def test_a_page_of_measured_figures_has_their_date_and_commit(name: str) -> None:
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert "Measured by `make " in text
    assert "<!-- code " in text


def test_a_mark_comes_with_a_change_of_the_code_and_goes_with_a_new_measurement() -> None:
    line = measured("paper", "--trainings 1")
    assert refreshed(f"Head\n\n{line} On two cores.\n") == f"Head\n\n{line} On two cores.\n"
    older = refreshed(line.replace(digest("paper"), "0123456789abcdef"))
    assert "**The code has changed since.** <!-- code 0123456789abcdef -->" in older
    assert refreshed(older) == older
    assert refreshed(older.replace("0123456789abcdef", digest("paper"))) == line


@pytest.mark.parametrize(
    ("changed", "is_dirty"),
    [
        ("", False),
        ("docs/hidden.md", False),
        ("tests/hidden/records/field.jsonl", False),
        ("docs/pages.py", True),
        ("README.md", True),
    ],
)
def test_results_that_were_written_before_make_no_other_commit(
    changed: str,
    is_dirty: bool,  # noqa: FBT001
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    files = ("docs/hidden.md", "docs/pages.py", "tests/hidden/records/field.jsonl", "README.md")
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("before", encoding="utf-8")
    who = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
    for arguments in (["init", "-q"], ["add", "."], [*who, "commit", "-q", "-m", "Begin"]):
        subprocess.run(["git", "-C", str(tmp_path), *arguments], check=True)
    if changed:
        (tmp_path / changed).write_text("after", encoding="utf-8")
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    found = provenance.commit.__wrapped__()
    assert found.endswith("-dirty") == is_dirty
    assert len(found.removesuffix("-dirty")) >= 7
