# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measures of code, on code whose measures are known."""

import ast
from pathlib import Path

import pytest

from tools.measures.__main__ import END, ROOT, START, write
from tools.measures.imports import circles, depth, graph, without_shortcuts
from tools.measures.measures import complexity, measures
from tools.measures.source import Function, lines_of_code, read
from tools.pictures.packages import packages_picture, rooms

OURS = "terrain_estimator/terrain_estimator"
FILES = {
    f"{OURS}/__init__.py": '"""Package."""\n',
    f"{OURS}/loose.py": '"""Shared."""\n\n\nclass Run:\n    """One."""\n',
    f"{OURS}/model/__init__.py": '"""Room."""\n',
    f"{OURS}/model/step.py": (
        '"""Where it goes."""\n\nfrom terrain_estimator import loose\n\n\n'
        "def go(a, b: int) -> int:\n"
        '    """Go."""\n'
        "    # a comment\n"
        "    return a if a and b else loose.x\n"
    ),
    f"{OURS}/cli/__init__.py": "",
    f"{OURS}/cli/run.py": (
        "from terrain_estimator.model.step import go\n\n\nclass Run:\n    x = go\n"
    ),
    "tests/test_step.py": "def test_step():\n    assert True\n",
}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path


def test_a_small_tree_has_the_measures_that_one_counts_by_hand(root: Path) -> None:
    assert measures(root) == {
        "files / functions": "6 / 1",
        "lines of a function: median / 90th percentile / longest": "3 / 3 / 3",
        "arguments and results with a type": "66.7 %",
        "public definitions with a docstring": "66.7 %",
        "lines of tests per line of code": "0.29",
        "cyclomatic complexity: 90th percentile / highest": "3 / 3",
        "lines of a file: 90th percentile / longest": "9 / 9",
        "most files in a folder": "2",
        "loose modules in the root of terrain_estimator": "1",
        "longest chain of imports": "3",
        "circles of imports": "0",
        "class names that stand for more than one class": "1",
        "docstrings that begin with What, Where or Whether": "16.7 %",
    }


def test_code_is_no_blank_line_comment_or_docstring() -> None:
    text = (
        '"""Doc\n\nmore."""\n\n# why\nx = 1\n\n\ndef f():\n    """Doc."""\n    return """a\nb"""\n'
    )
    assert lines_of_code(text) == {6, 9, 11, 12}


def test_complexity_counts_branches_and_leaves_inner_functions_out() -> None:
    text = """
def f(a):
    def inner():
        if a: pass
    for x in a:
        if x and a or x:
            return [y for y in a if y]
    try:
        assert a
    except ValueError:
        return 1 if a else 2
"""
    (function,) = ast.parse(text).body
    assert isinstance(function, Function)
    assert complexity(function) == 1 + 1 + 3 + 2 + 1 + 1 + 1


def test_chains_circles_and_shortcuts_of_imports() -> None:
    line = {"a": {"b", "c"}, "b": {"c"}, "c": set[str]()}
    assert (depth(line), circles(line)) == (3, [])
    assert without_shortcuts(line) == {"a": {"b"}, "b": {"c"}, "c": set()}
    ring = {"a": {"b"}, "b": {"c"}, "c": {"b"}}
    assert (depth(ring), circles(ring)) == (2, [{"b", "c"}])


def test_the_picture_has_a_box_for_each_room_and_an_arrow_for_each_import(root: Path) -> None:
    modules = read(root)
    assert rooms(modules) == {
        "shared modules": set(),
        "model": {"shared modules"},
        "cli": {"model"},
    }
    drawn = packages_picture(modules)
    assert [drawn.count(f">{room}</text>") for room in rooms(modules)] == [1, 1, 1]
    assert drawn.count('class="arrow"') == 2


def test_folders_that_import_in_a_circle_have_no_picture(root: Path) -> None:
    for folder, other in (("learning", "pages"), ("pages", "learning")):
        (root / OURS / folder).mkdir()
        text = f"from terrain_estimator.{other} import here\n"
        (root / OURS / folder / "there.py").write_text(text, encoding="utf-8")
        (root / OURS / folder / "here.py").write_text("x = 1\n", encoding="utf-8")
    modules = read(root)
    assert not circles(graph(modules))
    with pytest.raises(ValueError, match=r"in a circle: learning, pages$"):
        packages_picture(modules)


def test_neither_modules_nor_folders_of_ours_import_in_a_circle() -> None:
    modules = read(ROOT)
    assert (circles(graph(modules)), circles(rooms(modules))) == ([], [])


def test_the_table_replaces_what_stands_between_the_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"Head\n\n{START}\nold\n{END}\n\nTail\n", encoding="utf-8")
    write(page, ["new"])
    assert page.read_text(encoding="utf-8") == f"Head\n\n{START}\nnew\n{END}\n\nTail\n"
    page.write_text("no marks\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="expected the lines"):
        write(page, ["new"])
