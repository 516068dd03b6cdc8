# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Runs tests against a copy of the packages, one process a mutant."""

import contextlib
import dataclasses
import importlib
import json
import math
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.mutants.choice import Tree
from tests.mutants.mutations import Mutant

KILLED, SURVIVED, TIMED_OUT, NOT_COMPILED = "killed", "survived", "timed out", "does not compile"
LIMIT_S = 60.0
LAST_START = 0.8
"""Share of the limit after which no other test begins: a machine may be slower than measured."""
UNMUTATED = 0.95
"""Share of the limit in which the tests must end unmutated for time to be the mutant's fault."""
_NO_SCRIPT = 100  # exit status, beside pytest's
_PRELOAD = ["torch", "pytest", "scipy.stats", "yaml"]  # pytest loads its own plugins


@dataclasses.dataclass(frozen=True, slots=True)
class Job:
    """What a process does: compile what a function yields, then run tests."""

    path: tuple[str, ...]  # first on the path
    root: str
    tests: tuple[str, ...]  # node ids in their order; or files, to run all in them
    compiled: str = ""  # "module:function" that yields what torch.jit.script has to compile
    durations: str = ""  # file for the seconds of each test that passed
    last_start_s: float = math.inf  # [s] no test begins later


class Copy:
    """A copy of the packages of a tree in a temporary folder."""

    def __init__(self, tree: Tree, folder: Path) -> None:
        self._tree, self._folder = tree, folder
        for package in tree.packages:
            shutil.copytree(tree.root / package, folder / package)

    @property
    def path(self) -> tuple[str, ...]:
        """Folders to put first on the path."""
        parents = dict.fromkeys((self._folder / p).parent for p in self._tree.packages)
        return tuple(str(parent) for parent in parents)

    @contextlib.contextmanager
    def mutated(self, mutant: Mutant) -> Iterator[None]:
        """Hold the mutant in place of its file."""
        file = self._folder / mutant.file
        source = file.read_bytes()
        for compiled in file.parent.glob(f"__pycache__/{file.stem}.*.pyc"):
            compiled.unlink()
        file.write_bytes(mutant.apply(source))
        try:
            yield
        finally:
            file.write_bytes(source)


@contextlib.contextmanager
def copy_of(tree: Tree) -> Iterator[Copy]:
    """Hold a copy of the packages."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        yield Copy(tree, Path(folder))


def judge(copy: Copy, mutant: Mutant, job: Job, limit_s: float = LIMIT_S) -> tuple[str, float]:
    """Return the verdict about a mutant, and the seconds that it took.

    Where the tests run out of time unmutated too, the mutant survived. A mutant with which pytest
    cannot even import a conftest is killed.

    Raises:
        RuntimeError: no test of the job is there.
    """
    start = time.monotonic()
    job = dataclasses.replace(job, path=copy.path, last_start_s=LAST_START * limit_s)
    with copy.mutated(mutant):
        status = run(job, limit_s)
    if status is None and run(job, UNMUTATED * limit_s) is None:
        status = 0
    if status == pytest.ExitCode.NO_TESTS_COLLECTED:
        raise RuntimeError(f"{mutant.file}:{mutant.line}: pytest found no test to run")
    verdict = {None: TIMED_OUT, 0: SURVIVED, _NO_SCRIPT: NOT_COMPILED}.get(status, KILLED)
    return verdict, time.monotonic() - start


def run(job: Job, limit_s: float) -> int | None:
    """Run a job in a process of its own; return its exit status, None where it ran out of time."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOAD)
    process = context.Process(target=_work, args=(job,))
    process.start()
    process.join(limit_s)
    status = process.exitcode
    if process.pid is not None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.join()
    return status


def _work(job: Job) -> None:
    os.setsid()
    _silence()
    os.chdir(job.root)
    sys.dont_write_bytecode = True
    sys.path[:0] = [*job.path, job.root]
    os.environ["PYTHONPATH"] = os.pathsep.join(
        [*job.path, job.root, os.environ.get("PYTHONPATH", "")]
    )
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    if job.compiled and not _compiles(job.compiled):
        sys.exit(_NO_SCRIPT)
    plugin = _Plugin(job.tests, time.monotonic() + job.last_start_s)
    files = list(dict.fromkeys(name.split("::")[0] for name in job.tests))
    options = [] if job.durations else ["-x"]
    status = pytest.main([*options, "-q", "-p", "no:cacheprovider", *files], plugins=[plugin])
    if job.durations:
        Path(job.durations).write_text(json.dumps(plugin.passed))
    sys.exit(int(status))


def _silence() -> None:
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)


class _Plugin:
    """Selects and orders the tests, and notes the seconds of those that pass."""

    def __init__(self, tests: Sequence[str], last_start: float) -> None:
        self._order = {name: index for index, name in enumerate(tests)}
        self._last_start = last_start
        self.passed: dict[str, float] = {}
        self._failed: set[str] = set()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if any("::" in name for name in self._order):
            chosen = [item for item in items if item.nodeid in self._order]
            items[:] = sorted(chosen, key=lambda item: self._order[item.nodeid])

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self) -> bool | None:
        """Pass over a test, as if it had been run, where no time is left for it."""
        return True if time.monotonic() > self._last_start else None

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not report.passed:
            self._failed.add(report.nodeid)
            self.passed.pop(report.nodeid, None)
        elif report.nodeid not in self._failed:
            self.passed[report.nodeid] = self.passed.get(report.nodeid, 0.0) + report.duration


def _compiles(source: str) -> bool:
    """Return whether torch.jit.script compiles what ``source``, a "module:function", yields.

    Where that function raises, the tests will meet the same mutant: it counts as compiled.
    """
    import torch  # noqa: PLC0415 # only where a model is judged

    module, _, function = source.partition(":")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            models = list(getattr(importlib.import_module(module), function)())
        except Exception:  # noqa: BLE001 # whatever a mutant raises
            return True
        try:
            for model in models:
                torch.jit.script(model)
        except Exception:  # noqa: BLE001 # the compiler raises many classes
            return False
    return True
