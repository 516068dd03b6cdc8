# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Which tests a mutant meets: those that import its module, or a module that imports it."""

import ast
import itertools
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

OUTSIDE = ("system", "faults", "workspace", "fuzz", "mutants", "benchmarks")
"""Folders of tests that start processes or take longer than a mutant may."""


@dataclass(frozen=True)
class Tree:
    """A repository: its packages, each folder of which is on the path, and its tests."""

    root: Path
    packages: tuple[str, ...]  # folders relative to the root
    others: tuple[str, ...] = ()  # folders of modules that tests may import, besides tests/
    outside: frozenset[str] = field(default=frozenset(OUTSIDE))

    def module(self, file: str) -> str:
        """Return the dotted name of a ``file``, relative to the root."""
        for package in self.packages:
            parent = package.rpartition("/")[0]
            if file.startswith(f"{package}/"):
                file = file[len(parent) + 1 :] if parent else file
                break
        return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")

    def tests(self) -> list[str]:
        """Return the files of tests that may judge a mutant."""
        found = (self.root / "tests").rglob("test_*.py")
        paths = sorted(path.relative_to(self.root) for path in found)
        return [path.as_posix() for path in paths if not self.outside & set(path.parts)]

    @cached_property
    def imports(self) -> dict[str, set[str]]:
        """Names that each module or test imports; ``from a import b`` counts as a and as a.b."""
        files = (
            path.relative_to(self.root).as_posix()
            for folder in (*self.packages, *self.others, "tests")
            for path in (self.root / folder).rglob("*.py")
        )
        return {self.module(file): _imported((self.root / file).read_text()) for file in files}

    @cached_property
    def faces(self) -> frozenset[str]:
        """Packages whose ``__init__`` hands on names of their modules."""
        files = (path for folder in self.packages for path in (self.root / folder).rglob("*.py"))
        inits = (path for path in files if path.name == "__init__.py")
        names = (self.module(path.relative_to(self.root).as_posix()) for path in inits)
        return frozenset(name for name in names if self.imports[name])

    def judges(self, file: str) -> list[tuple[int, str]]:
        """Return the tests that import ``file``, each with its distance.

        The distance is the number of modules between, and one more for a test that is not in the
        folder of tests of ``file``. One module stands between at most; where no test is so near, as
        many as the nearest need. The face of a package does not count as a module between.
        """
        own = f"tests/{self.module(file).replace('.', '/').rpartition('/')[0]}/"
        tests, names = self.tests(), {self.module(file)}
        found: dict[str, int] = {}
        for between in itertools.count():
            near = [test for test in tests if names & self.imports[self.module(test)]]
            found |= {test: between for test in near if test not in found}
            importers = {name for name, own in self.imports.items() if names & own}
            if (found and between) or importers <= names:
                break
            names |= importers
            names |= {face for face in self.faces if names & self.imports[face]}
        return [(n + (not test.startswith(own)), test) for test, n in found.items()]


def _imported(source: str) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


FILE_S = 0.3
"""[s] It takes to import one more file of tests."""


def choose(
    judges: Iterable[tuple[int, str]], seconds: dict[str, float], budget_s: float
) -> list[str]:
    """Return node ids of the ``judges`` in the order in which to run them.

    ``seconds`` are those of each test unmutated. The nearest come first, then the quickest;
    together they take ``budget_s`` at most, the import of their files included.
    """
    tests = [
        (distance, duration, name)
        for distance, file in judges
        for name, duration in seconds.items()
        if name.split("::")[0] == file
    ]
    chosen: dict[tuple[int, str], list[str]] = {}
    spent: defaultdict[str, float] = defaultdict(float)
    for distance, duration, name in sorted(tests):
        file = name.split("::")[0]
        costs = duration + (0.0 if file in spent else FILE_S)
        if sum(spent.values()) + costs <= budget_s:
            chosen.setdefault((distance, file), []).append(name)
            spent[file] += costs
    order = sorted(chosen, key=lambda group: (group[0], spent[group[1]], group[1]))
    return [name for group in order for name in chosen[group]]
