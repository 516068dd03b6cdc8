# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The drawing and judging of mutants, on a toy library with one test."""

import dataclasses
import tomllib
from pathlib import Path

import pytest

from tests.mutants.__main__ import PACKAGES, Plan, draw, judge_all
from tests.mutants.choice import Tree, choose
from tests.mutants.judge import (
    KILLED,
    NOT_COMPILED,
    SURVIVED,
    TIMED_OUT,
    UNMUTATED,
    Job,
    copy_of,
    judge,
    run,
)
from tests.mutants.mutations import Mutant, find_mutants
from tests.mutants.table import Equivalents, Results, Verdict, as_markdown, killed_share, passes

EQUIVALENTS = Path(__file__).parent / "equivalent.toml"
LAWS_OF_SOIL = "terramechanics/terramechanics/effects/soil.py"

FILE = "terramechanics/terramechanics/toy.py"
MODULE = '''"""A toy."""

from torch import Tensor


def twice(x: Tensor, steps: int = 1) -> Tensor:
    """Twice x; a reader may ask for more steps."""
    scale = 2.0
    if steps > 5:
        raise ValueError("more than 5 steps")
    return scale * x.abs() if steps < 3 else x


def countdown(n: int) -> int:
    """Zero."""
    while n != 0:
        n -= 1
    return n


def least(x: Tensor) -> Tensor:
    """The smaller of x and one."""
    return x.clamp(max=1.0)
'''
TEST = """import torch
from terramechanics.toy import countdown, least, twice


def test_that_is_quick():
    assert twice(torch.tensor(-2.0)) == 4.0
    assert countdown(3) == 0


def test_that_is_slow():
    assert least(torch.tensor(0.5)) == 0.5
"""
SCRIPTED = """from terramechanics.toy import least, twice


def models():
    yield twice
    yield least
"""


@pytest.fixture(name="plan")
def toy(tmp_path: Path) -> Plan:
    texts = {
        FILE: MODULE,
        "terramechanics/terramechanics/__init__.py": "",
        "terramechanics/terramechanics/scripted.py": SCRIPTED,
        "tests/test_toy.py": TEST,
        "tests/test_other.py": "def test_nothing():\n    assert True\n",
    }
    for name, text in texts.items():
        path = tmp_path / "repository" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    tree = Tree(tmp_path / "repository", ("terramechanics/terramechanics",))
    return Plan(
        tree, tmp_path / "kept", Equivalents(tmp_path / "none.toml"),
        "terramechanics.scripted:models",
    )  # fmt: skip


def changed(plan: Plan, *lines: str) -> list[Mutant]:
    """The mutants of the toy whose line is one of ``lines``."""
    found = {mutant.mutated_line: mutant for mutant in find_mutants(plan.tree.root, FILE)}
    return [found[line] for line in lines]


CASES = {
    "scale = 4.0": KILLED,
    "if steps >= 5:": SURVIVED,
    "while n == 0:": KILLED,
    "return scale * x.abs() if steps < 2 else x": SURVIVED,
    "return x.clamp(min=1.0)": KILLED,
}


def test_mutants_are_killed_or_survive_and_none_is_judged_twice(
    plan: Plan,
) -> None:
    drawn, told = changed(plan, *CASES), list[str]()
    path = plan.folder / "mutants.json"
    verdicts = judge_all(plan, drawn, len(drawn), Results(path), told.append)
    assert {v.mutated: v.verdict for v in verdicts} == CASES
    assert len(told) == len(drawn)
    again = judge_all(plan, drawn, len(drawn), Results(path), told.append)
    assert again == verdicts
    assert len(told) == len(drawn)
    assert killed_share(verdicts) == pytest.approx(3 / 5)
    assert (plan.tree.root / FILE).read_text() == MODULE


@pytest.mark.parametrize(
    ("statuses", "verdict"), [([None, 0], TIMED_OUT), ([None, None], SURVIVED), ([1], KILLED)]
)
def test_a_timeout_is_a_kill_where_the_unmutated_module_is_quick(
    plan: Plan, statuses: list[int | None], verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits: list[float] = []

    def answer(_: Job, limit_s: float) -> int | None:
        limits.append(limit_s)
        return statuses[len(limits) - 1]

    monkeypatch.setattr("tests.mutants.judge.run", answer)
    (mutant,) = changed(plan, "n -= 2")
    with copy_of(plan.tree) as copy:
        assert judge(copy, mutant, Job((), "", ()), 8.0)[0] == verdict
    assert limits == pytest.approx([8.0, UNMUTATED * 8.0][: len(statuses)])


def test_a_job_that_hangs_is_ended_at_its_limit(plan: Plan) -> None:
    hang = "import time\n\n\ndef test_that_hangs():\n    time.sleep(600)\n"
    (plan.tree.root / "tests/test_hang.py").write_text(hang)
    assert run(Job((), str(plan.tree.root), ("tests/test_hang.py",)), 2.0) is None


def test_no_test_begins_when_the_time_is_nearly_up(plan: Plan) -> None:
    late = "def test_that_comes_too_late():\n    raise AssertionError\n"
    slow = "import time\n\n\ndef test_that_is_slow():\n    time.sleep(0.5)\n\n\n"
    (plan.tree.root / "tests/test_late.py").write_text(slow + late)
    names = tuple(
        f"tests/test_late.py::{name}" for name in ("test_that_is_slow", "test_that_comes_too_late")
    )
    job = Job((), str(plan.tree.root), names, last_start_s=30.0)
    assert run(job, 60.0) == pytest.ExitCode.TESTS_FAILED
    assert run(dataclasses.replace(job, last_start_s=0.0), 60.0) == pytest.ExitCode.OK


def test_a_mutant_that_breaks_the_import_of_a_conftest_is_killed(plan: Plan) -> None:
    conftest = "from terramechanics.toy import countdown\n\nassert countdown(1) == 0\n"
    (plan.tree.root / "tests/conftest.py").write_text(conftest)
    (mutant,) = changed(plan, "while n == 0:")
    job = Job((), str(plan.tree.root), ("tests/test_other.py",))
    with copy_of(plan.tree) as copy:
        assert judge(copy, mutant, job)[0] == KILLED


def test_a_module_that_no_test_imports_is_an_error(plan: Plan) -> None:
    (plan.tree.root / "tests/test_toy.py").unlink()
    (plan.tree.root / "terramechanics/terramechanics/scripted.py").write_text("")
    (mutant,) = changed(plan, "scale = 4.0")
    with pytest.raises(RuntimeError, match="no test imports it"):
        judge_all(plan, [mutant], 1, Results(plan.folder / "mutants.json"), list[str]().append)


def test_a_mutant_that_torchscript_cannot_compile_is_replaced_by_another(plan: Plan) -> None:
    root, told = plan.tree.root, list[str]()
    file = root / FILE
    file.write_text(MODULE.replace("scale = 2.0", "scale = [2.0][0] if steps < 9 else 2.0"))
    (good,) = changed(plan, "return x.clamp(max=2.0)")
    at = file.read_bytes().index(b"[2.0][0]")
    uncompiled = Mutant(
        FILE, 8, at, at + 8, "[lambda: 2.0][0]()", "scale = ...", "scale = [lambda: 2.0][0]()"
    )
    results = Results(plan.folder / "mutants.json")
    verdicts = judge_all(plan, [uncompiled, good, good], 1, results, told.append)
    assert [v.verdict for v in verdicts][:1] == [NOT_COMPILED]
    assert sum(v.verdict != NOT_COMPILED for v in verdicts) == 1


def test_texts_types_and_docstrings_are_no_mutants(plan: Plan) -> None:
    lines = {mutant.line for mutant in find_mutants(plan.tree.root, FILE)}
    texts = {number for number, line in enumerate(MODULE.splitlines(), 1) if '"' in line}
    assert not lines & texts
    assert lines >= {6, 8, 9, 11, 16, 17, 23}


def test_the_same_seed_draws_the_same_mutants(plan: Plan) -> None:
    assert draw(plan.tree, [FILE], 3) == draw(plan.tree, [FILE], 3) != draw(plan.tree, [FILE], 4)


def test_tests_that_import_the_module_judge_it_the_nearest_and_quickest_first(plan: Plan) -> None:
    root = plan.tree.root
    (root / "terramechanics/terramechanics/user.py").write_text("from terramechanics import toy\n")
    (root / "tests/test_user.py").write_text("import terramechanics.user\n")
    judges = Tree(root, plan.tree.packages).judges(FILE)
    assert judges == [(1, "tests/test_toy.py"), (2, "tests/test_user.py")]
    seconds = {
        "tests/test_user.py::test_b": 0.1,
        "tests/test_toy.py::test_slow": 2.0,
        "tests/test_toy.py::test_quick": 1.0,
        "tests/test_toy.py::test_slowest": 3.0,
        "tests/test_other.py::test_c": 0.1,
    }
    assert choose(judges, seconds, 3.8) == [
        "tests/test_toy.py::test_quick",
        "tests/test_toy.py::test_slow",
        "tests/test_user.py::test_b",
    ]


def test_tests_in_the_folder_of_the_module_come_before_others_as_near(plan: Plan) -> None:
    own = plan.tree.root / "tests/terramechanics/test_own.py"
    own.parent.mkdir()
    own.write_text("from terramechanics.toy import least\n")
    judges = Tree(plan.tree.root, plan.tree.packages).judges(FILE)
    assert sorted(judges) == [(0, "tests/terramechanics/test_own.py"), (1, "tests/test_toy.py")]


def test_an_equivalent_mutant_does_not_count_and_a_tenth_may_be_equivalent(
    plan: Plan, tmp_path: Path
) -> None:
    (mutant,) = changed(plan, "if steps >= 5:")
    listed = tmp_path / "equivalent.toml"
    entry = f'[[equivalent]]\nfile = "{FILE}"\nline = "if steps > 5:"\n'
    listed.write_text(f'{entry}mutant = "if steps >= 5:"\nreason = "5 is never given"\n')
    assert Equivalents(listed).reason(mutant) == "5 is never given"
    assert not Equivalents(listed).reason(changed(plan, "scale = 4.0")[0])

    def verdicts(killed: int, survived: int, equivalent: int) -> list[Verdict]:
        kinds = [(KILLED, "")] * killed + [(SURVIVED, "")] * survived
        kinds += [(SURVIVED, "argued")] * equivalent + [(NOT_COMPILED, "")] * 50
        return [
            Verdict(str(k), FILE, 1, "a", "b", kind, 1.0, why)
            for k, (kind, why) in enumerate(kinds)
        ]

    assert passes(verdicts(95, 5, 0))
    assert not passes(verdicts(94, 6, 0))
    assert passes(verdicts(90, 0, 10))
    assert not passes(verdicts(89, 0, 11))
    table = as_markdown(verdicts(95, 5, 2), 1)
    assert f"| {FILE} | 95 | 0 | 5 | 2 | 50 |" in table
    assert "95.0%" in table


def test_the_face_of_a_package_is_no_module_between() -> None:
    tree = Tree(Path(__file__).parents[2], PACKAGES)
    judges = {test: between for between, test in tree.judges(LAWS_OF_SOIL)}
    assert judges["tests/terramechanics/effects/test_effects.py"] <= 1


def test_every_argued_equivalent_is_about_a_line_that_is_there() -> None:
    root = Path(__file__).parents[2]
    for entry in tomllib.loads(EQUIVALENTS.read_text(encoding="utf-8"))["equivalent"]:
        lines = (root / entry["file"]).read_text(encoding="utf-8").splitlines()
        assert entry["line"] in map(str.strip, lines), entry
