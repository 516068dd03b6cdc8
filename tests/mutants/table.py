# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The verdicts of a run in a file, from which an interrupted run goes on, and their report."""

import json
import threading
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.mutants.judge import KILLED, NOT_COMPILED, SURVIVED, TIMED_OUT
from tests.mutants.mutations import Mutant

REQUIRED = 0.95
"""[1] Share of the mutants that are not equivalent to be killed."""
MOST_EQUIVALENT = 0.1
"""[1] Share of the mutants that may be argued to be equivalent."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one mutant."""

    key: str
    file: str
    line: int
    original: str
    mutated: str
    verdict: str
    seconds: float
    equivalent: str = ""  # why no test can tell


class Equivalents:
    """The mutants that are argued to be equivalent, by file, line text and mutated line text."""

    def __init__(self, path: Path) -> None:
        entries = tomllib.loads(path.read_text()).get("equivalent", []) if path.exists() else []
        self._reasons = {(e["file"], e["line"], e["mutant"]): e["reason"] for e in entries}

    def reason(self, mutant: Mutant) -> str:
        """Return why a mutant is equivalent, or nothing."""
        return self._reasons.get((mutant.file, mutant.original_line, mutant.mutated_line), "")


class Results:
    """Verdicts by key, written to ``path`` after each."""

    def __init__(self, path: Path) -> None:
        self._path, self._lock = path, threading.Lock()
        self._verdicts: dict[str, dict[str, object]] = {}
        if path.exists():
            self._verdicts = {v["key"]: v for v in json.loads(path.read_text())["mutants"]}

    def known(self, key: str) -> tuple[str, float] | None:
        """Return the verdict about a mutant and its seconds, where there is one."""
        found = self._verdicts.get(key)
        return None if found is None else (str(found["verdict"]), float(str(found["seconds"])))

    def add(self, verdict: Verdict) -> None:
        """Keep a verdict."""
        with self._lock:
            self._verdicts[verdict.key] = asdict(verdict)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            whole = json.dumps({"mutants": list(self._verdicts.values())}, indent=1)
            part = self._path.with_suffix(".part")
            part.write_text(whole + "\n")
            part.replace(self._path)


def killed_share(verdicts: Sequence[Verdict]) -> float:
    """Return the share [1] of those neither equivalent nor uncompiled that the tests killed."""
    counted = [v for v in verdicts if not v.equivalent and v.verdict != NOT_COMPILED]
    return sum(v.verdict in {KILLED, TIMED_OUT} for v in counted) / max(len(counted), 1)


def passes(verdicts: Sequence[Verdict]) -> bool:
    """Return whether enough are killed, and few enough argued away."""
    judged = [v for v in verdicts if v.verdict != NOT_COMPILED]
    equivalent = sum(bool(v.equivalent) for v in judged)
    return killed_share(verdicts) >= REQUIRED and equivalent <= MOST_EQUIVALENT * len(judged)


def as_markdown(verdicts: Sequence[Verdict], seed: int) -> str:
    """Return the table of the modules and the list of the survivors."""
    names = (KILLED, TIMED_OUT, SURVIVED, "equivalent", NOT_COMPILED)
    counts: dict[str, Counter[str]] = {}
    for verdict in verdicts:
        kind = "equivalent" if verdict.equivalent and verdict.verdict == SURVIVED else None
        counts.setdefault(verdict.file, Counter())[kind or verdict.verdict] += 1
    rows = [[file, *(str(count[name]) for name in names)] for file, count in sorted(counts.items())]
    total: Counter[str] = sum(counts.values(), Counter())
    rows.append(["all", *(str(total[name]) for name in names)])
    lines = [
        f"# Mutants of seed {seed}",
        "",
        f"{killed_share(verdicts):.1%} of those that are not equivalent are killed.",
        "",
        *_table(["module", *names], rows),
        "",
        "## Survivors",
        "",
    ]
    survivors = [v for v in verdicts if v.verdict == SURVIVED]
    for v in sorted(survivors, key=lambda v: (v.file, v.line)):
        lines += [f"- {v.file}:{v.line} `{v.original}` -> `{v.mutated}`"]
        lines += [f"  - equivalent: {v.equivalent}"] if v.equivalent else []
    return "\n".join(lines) + "\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
