# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Damage sound files at random places, many times, and read each: `make fuzz ARGS="--mutations N"`.

Unlike libFuzzer's search it draws independently, so that a count without a finding limits the share
of such files that would be one.
"""

import random
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scipy.stats import binomtest

from tests.fuzz.targets import TARGETS, Target

SLOWEST_S = 5.0
"""[s] of processor time; more is a finding."""


def mutated(generator: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Return a seed with one to eight changes: bytes changed, cut, repeated, moved or inserted."""
    data = bytearray(generator.choice(seeds))
    for _ in range(generator.randint(1, 8)):
        start = generator.randrange(len(data) + 1)
        end = min(len(data), start + generator.choice((0, 1, 1, 2, 4, 8, 64, 512)))
        match generator.randrange(6):
            case 0:
                data[start:end] = generator.randbytes(end - start)
            case 1:
                del data[start:end]
            case 2:
                data[start:start] = data[start:end] * generator.choice((1, 2, 50))
            case 3:
                data[start:end] = generator.choice((b"\0", b"\xff", b"\x7f")) * (end - start)
            case 4:
                other = generator.randrange(len(data) + 1)
                data[start:end] = data[other : other + end - start]
            case _:
                del data[start if generator.random() < 0.1 else len(data) - (end - start) :]
    return bytes(data)


@dataclass(frozen=True, slots=True)
class Damage:
    """How one reader took randomly damaged files."""

    files: int
    findings: int
    slowest_s: float  # of processor time

    @property
    def limit(self) -> float:
        """Largest share of such files that would be findings, with 95 % confidence [1]."""
        return float(binomtest(self.findings, self.files).proportion_ci(0.9, "exact").high)


def mutations(name: str, number: int, seed: int, out: Path) -> Damage:
    """Read so many damaged files with a target; findings are kept in ``out`` and printed."""
    generator, target = random.Random(f"{seed} {name}"), TARGETS[name]
    seeds, findings, slowest_s = target.seeds(), 0, 0.0
    for _ in range(number):
        data = mutated(generator, seeds)
        wrong, taken_s = _attempt(target, data)
        slowest_s = max(slowest_s, taken_s)
        if wrong:
            findings += 1
            out.mkdir(parents=True, exist_ok=True)
            place = out / f"{name.replace(' ', '_')}_{findings}"
            place.write_bytes(data)
            sys.stdout.write(f"{name}: {wrong}: {place}\n")
    found = Damage(number, findings, slowest_s)
    sys.stdout.write(
        f"{name}: {number} damaged files, {findings} findings, 95 % limit {found.limit:.1g},"
        f" slowest {slowest_s:.2f} s\n"
    )
    sys.stdout.flush()
    return found


def _attempt(target: Target, data: bytes) -> tuple[str, float]:
    started = time.process_time()
    try:
        target(data)
    except Exception as error:  # noqa: BLE001 - any is a finding
        return f"{type(error).__name__}: {str(error)[:200]}", time.process_time() - started
    taken_s = time.process_time() - started
    return (f"took {taken_s:.1f} s" if taken_s > SLOWEST_S else ""), taken_s
