# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Draws mutants and judges them by the tests: ``make mutants``, or ``python -m tests.mutants``.

A mutant is one small change of the library, such as ``<`` for ``<=``. Each meets the tests that
import its module, directly or through one other module, until one fails. The changed module stands
in a copy of the packages. A mutant that torch.jit.script cannot compile is replaced by another.

The drawn mutants follow from SEED, which was fixed after the tests were written and before they
met these mutants. Other seeds and single files (``--seed``, ``--files``) served to find out what
the tests lacked. A run that was broken off goes on where it stopped.

Exit status 1: fewer than 95 % of the mutants that are not equivalent are killed, or more than
10 % are argued to be equivalent (equivalent.toml).
"""

import argparse
import hashlib
import itertools
import json
import random
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tests.mutants.choice import Tree, choose
from tests.mutants.judge import LIMIT_S, NOT_COMPILED, Copy, Job, copy_of, judge, run
from tests.mutants.mutations import Mutant, files_below, find_mutants
from tests.mutants.table import Equivalents, Results, Verdict, as_markdown, killed_share, passes

SEED = 20261204
NUMBER = 300
PACKAGES = ("terramechanics/terramechanics", "terrain_estimator/terrain_estimator")
MUTATED = (PACKAGES[0], *(f"{PACKAGES[1]}/{name}" for name in ("model", "estimator", "messaging")))
SCRIPTED = (MUTATED[0], MUTATED[1])
"""Folders of what a model file holds."""
BUDGET_S = 30.0
"""[s] The tests of one mutant take unmutated: half of what it may take, so that time runs out only
where the mutant is at fault."""
SLOWEST_FILE_S = 900.0


@dataclass(frozen=True, slots=True)
class Plan:
    """What to judge, and by what."""

    tree: Tree
    folder: Path  # for what is kept between runs
    equivalents: Equivalents
    compiled: str = ""  # "module:function" that yields what a mutant of SCRIPTED has to compile
    processes: int = 2
    budget_s: float = BUDGET_S
    limit_s: float = LIMIT_S


def draw(tree: Tree, files: Sequence[str], seed: int) -> list[Mutant]:
    """Return all mutants of the ``files`` in a random order."""
    found = [mutant for file in files for mutant in find_mutants(tree.root, file)]
    random.Random(seed).shuffle(found)  # no secret
    return found


def measure(plan: Plan, tests: Sequence[str], tell: Callable[[str], None]) -> dict[str, float]:
    """Return the seconds of each test of the files ``tests`` unmutated, of those that pass.

    They are kept by the text of the test's file: what did not change is not measured again.
    """
    kept = plan.folder / "durations"
    kept.mkdir(parents=True, exist_ok=True)

    def one(file: str) -> dict[str, float]:
        digest = hashlib.sha256((plan.tree.root / file).read_bytes()).hexdigest()[:16]
        path = kept / f"{digest}.json"
        if not path.exists():
            with copy_of(plan.tree) as copy:
                job = Job(copy.path, str(plan.tree.root), (file,), durations=str(path))
                status = run(job, SLOWEST_FILE_S)
            if status is None:
                tell(f"{file}: took longer than {SLOWEST_FILE_S:.0f} s, left out")
                path.write_text("{}")
            elif not path.exists():
                raise RuntimeError(f"{file}: pytest could not run it, exit status {status}")
        return dict(json.loads(path.read_text()))

    with ThreadPoolExecutor(plan.processes) as pool:
        return {name: s for found in pool.map(one, tests) for name, s in found.items()}


def judge_all(
    plan: Plan, drawn: Sequence[Mutant], number: int, results: Results, tell: Callable[[str], None]
) -> list[Verdict]:
    """Judge the ``drawn`` until ``number`` have compiled; return all verdicts in order."""
    tree = plan.tree
    judges = {file: tree.judges(file) for file in {mutant.file for mutant in drawn}}
    tests = sorted({test for found in judges.values() for _, test in found})
    seconds = measure(plan, tests, tell)
    chosen = {f: tuple(choose(found, seconds, plan.budget_s)) for f, found in judges.items()}

    def one(mutant: Mutant, copy: Copy) -> Verdict:
        source = (tree.root / mutant.file).read_bytes()
        if not chosen[mutant.file]:
            raise RuntimeError(f"{mutant.file}: no test imports it within {plan.budget_s:.0f} s")
        key = f"{mutant.key(source)}:{_digest(tree, chosen[mutant.file])}"
        known = results.known(key)
        if known is None:
            compiled = plan.compiled if mutant.file.startswith(SCRIPTED) else ""
            job = Job((), str(tree.root), chosen[mutant.file], compiled)
            found = judge(copy, mutant, job, plan.limit_s)
            place = f"{mutant.file}:{mutant.line}"
            tell(f"{found[0]:12} {found[1]:5.1f} s {place} {mutant.mutated_line[:90]}")
        else:
            found = known
        verdict = Verdict(
            key, mutant.file, mutant.line, mutant.original_line, mutant.mutated_line, *found,
            plan.equivalents.reason(mutant),
        )  # fmt: skip
        if known is None:
            results.add(verdict)
        return verdict

    return _in_parallel(plan, drawn, number, one)


def _digest(tree: Tree, tests: Sequence[str]) -> str:
    files = sorted({name.split("::")[0] for name in tests})
    return hashlib.sha256(b"".join((tree.root / f).read_bytes() for f in files)).hexdigest()[:12]


def _in_parallel(
    plan: Plan, drawn: Sequence[Mutant], number: int, one: Callable[[Mutant, Copy], Verdict]
) -> list[Verdict]:
    """Judge in the drawn order, several at a time, until ``number`` have compiled."""
    queue: Iterator[tuple[int, Mutant]] = enumerate(drawn)
    verdicts: dict[int, Verdict] = {}

    def work() -> None:
        with copy_of(plan.tree) as copy:
            for index, mutant in queue:
                verdicts[index] = one(mutant, copy)
                if sum(v.verdict != NOT_COMPILED for v in verdicts.copy().values()) >= number:
                    return

    with ThreadPoolExecutor(plan.processes) as pool:
        for future in [pool.submit(work) for _ in range(plan.processes)]:
            future.result()
    ordered = [verdicts[index] for index in sorted(verdicts)]
    compiled = itertools.accumulate(v.verdict != NOT_COMPILED for v in ordered)
    return [v for v, so_far in zip(ordered, compiled, strict=True) if so_far <= number]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--number", type=int, default=NUMBER, help="mutants to judge")
    parser.add_argument("--files", nargs="*", help="modules to mutate, each by a part of its path")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--budget", type=float, default=BUDGET_S, help="[s] tests of a mutant")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder of the results")
    given = parser.parse_args(arguments)
    root = Path(__file__).resolve().parents[2]
    tree = Tree(root, PACKAGES, ("studies", "benchmarks", "rover_parameters", "docs"))
    files = [f for f in files_below(root, MUTATED) if _named(f, given.files)]
    plan = Plan(
        tree, given.out / "mutants", Equivalents(Path(__file__).with_name("equivalent.toml")),
        "tests.mutants.models:models", given.processes, given.budget,
    )  # fmt: skip
    results = Results(given.out / "mutants.json")
    verdicts = judge_all(plan, draw(tree, files, given.seed), given.number, results, _tell)
    text = as_markdown(verdicts, given.seed)
    (given.out / "mutants.md").write_text(text)
    _tell(text)
    _tell(f"{killed_share(verdicts):.1%} of {len(verdicts)} killed; {given.out}/mutants.md")
    return 0 if passes(verdicts) else 1


def _named(file: str, parts: Sequence[str] | None) -> bool:
    return not parts or any(part in file for part in parts)


def _tell(text: str) -> None:
    print(text, flush=True)  # noqa: T201 # a command


if __name__ == "__main__":
    sys.exit(main())
