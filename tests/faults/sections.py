# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The sections of docs/faults.md about system calls and saved states."""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import torch

from docs.provenance import measured
from terrain_estimator.model.model_file import load_model
from tests.faults import states
from tests.faults.page import machine
from tests.faults.syscalls.filter import compiled, environment

CALLS_HEADING = "Every system call"
CALLS = """{measured}
Machine: {machine}.

Each program runs in a process whose n-th system call on its own files fails: open, write, fsync,
rename, close and mkdir, counted from 1. Every n to 200 is run, then 50 that are drawn by a seed.
`MemoryError` is raised at the n-th call of a function of ours instead. After each run:

- what was written before is whole: messages, the earlier state, the damaged bag, earlier results;
- there is at most one line for each result (a state has a copy for replays; a replay has estimates
  and a summary), and one where the exit code is not 0;
- the process goes on, or ends with a documented code.

| program | fault | calls | runs | exit codes | not so |
|---|---|---|---|---|---|
"""
STATES_HEADING = "Hostile states"
STATES = """{measured}
Machine: {machine}.

Numbers of a saved state are set to NaN, infinity, 0 and the largest and smallest numbers, scaled,
exchanged and cut, in one to three of its arrays, behind a right sha256. An estimator restores each
and goes on for {updates} observations.

- Hostile states: {states}, of which {refused} were refused by name and {taken} taken.
- Errors, and published numbers that are not finite or covariances that are not positive definite:
  **{wrong}** (at most {limit:.2f} % of such states, with 95 % confidence).
- Outcomes after those taken: {outcomes}.
- States of drives with faulty sensors and clocks: {honest}, of which {lost} were refused.
"""
HOSTILE, SEEDS, HONEST = 5000, 10, 100
"""Hostile states, the seeds that share them, and honest states for each seed."""


def calls(arguments: list[str]) -> tuple[str, bool]:
    """Run the sweep; return its section, and whether all was as it must be."""
    with tempfile.TemporaryDirectory() as folder:
        library = compiled(Path(folder))
        if library is None:
            return "Not measured: there is no C compiler.", False
        command = [sys.executable, "-m", "tests.faults.syscalls.sweep", *arguments]
        lines = []
        with subprocess.Popen(
            command, env=environment(library), stdout=subprocess.PIPE, text=True
        ) as process:
            for line in process.stdout or ():
                lines.append(line)
                sys.stdout.write(line)
                sys.stdout.flush()
    rows = [json.loads(line) for line in lines]
    text = CALLS.format(measured=measured("faults"), machine=machine())
    return text + "\n".join(map(_row, rows)), process.returncode == 0


def _row(row: dict[str, Any]) -> str:
    codes = ", ".join(f"{code}: {count}" for code, count in row["codes"].items())
    cells = (row["scenario"], row["kind"], row["calls"], row["runs"], codes)
    return f"| {' | '.join(map(str, cells))} | {len(row['complaints'])} |"


def hostile_states() -> tuple[str, bool]:
    """Run hostile and honest states; return their section, and whether nothing is wrong."""
    torch.set_num_threads(1)
    model, total = load_model(), states.Result()
    honest = lost = 0
    for seed in range(1, SEEDS + 1):
        total += states.run(model, HOSTILE // SEEDS, seed)
        refusals = states.refused_honest(model, seed, HONEST)
        honest, lost = honest + HONEST, lost + len(refusals)
        sys.stdout.write(f"{total.states} states, {len(total.wrong)} wrong, {lost} lost\n")
        sys.stdout.writelines(f"    {line}\n" for line in [*total.wrong, *refusals][:20])
        sys.stdout.flush()
    outcomes = Counter(total.outcomes)
    return STATES.format(
        measured=measured("faults"),
        machine=machine(),
        updates=states.UPDATES,
        states=total.states,
        refused=total.refused.total(),
        taken=total.taken,
        wrong=len(total.wrong),
        limit=100.0 * (1.0 - 0.05 ** (1.0 / total.states)),
        outcomes=", ".join(f"{count} {name}" for name, count in sorted(outcomes.items())) or "none",
        honest=honest,
        lost=lost,
    ), not (total.wrong or lost)
