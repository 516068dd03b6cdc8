# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Cases of drives with turns and a hidden effect: ``python -m ...discovery.turning_batch``.

Laws are those of tests/hidden, none of the library's; sizes and grounds are drawn with the seed of
a case. It prints a line for every case, of which docs/discovery.md has the counts.
"""

import sys
from collections.abc import Callable

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import read_thresholds
from terrain_estimator.discovery.hypotheses.library import singles_by_wheel
from terrain_estimator.discovery.proof.soil_proof import proven
from terrain_estimator.discovery.report.investigation import investigate_as_told
from terramechanics.simulation.plant import Effect
from tests.hidden.soil import LugThrust, PassiveWedge
from tests.hidden.vehicle import DryBearing
from tests.turning_hidden import SKID, STEERED, Turning, turning_runs

DRIVES, SECONDS = 4, 40.0
"""Drives of a case, of which the last is held out, and their length [s]."""
SEED = 93_000_000
CASES = 3
"""Cases of each hidden effect, and of nothing."""
Make = Callable[[Tensor], Effect]
HIDDEN: dict[str, tuple[Make, float, float]] = {
    "bulldozing": (PassiveWedge, 0.5, 1.5),
    "coulomb_drag": (DryBearing, 0.2, 0.8),
    "grousers": (LugThrust, 0.004, 0.012),
}
"""Law, smallest and largest size, by the name of the library's effect."""
TRIED: tuple[tuple[Turning, tuple[str, ...]], ...] = (
    (SKID, ("bulldozing", "coulomb_drag", "grousers", "")),
    (STEERED, ("coulomb_drag", "")),
)


def main() -> int:
    """Print every case."""
    torch.set_num_threads(1)
    for turning, names in TRIED:
        for kind, name in enumerate(names):
            for number in range(CASES):
                seed = SEED + 100 * turning.kind + 10 * kind + number
                sys.stdout.write(
                    f"{turning.rover.name}, {name or 'nothing'}: {line(turning, name, seed)}\n"
                )
                sys.stdout.flush()
    return 0


def line(turning: Turning, name: str, seed: int) -> str:
    """Return the verdict on a case, and what the held-out drive says."""
    effect, size = None, 0.0
    if name:
        make, low, high = HIDDEN[name]
        share = torch.rand(
            1, generator=torch.Generator().manual_seed(seed + 5), dtype=torch.float64
        )
        size = float(low * (high / low) ** share)
        effect = make(torch.full((DRIVES,), size, dtype=torch.float64))
    runs = turning_runs(turning, effect, seed, DRIVES, SECONDS)
    with torch.inference_mode():
        study = Study(turning.nominal, runs[:-1])
        given = (study, singles_by_wheel(), read_thresholds(), lambda _share, _label: None, 0.0)
        outcome = proven(investigate_as_told(*given), study, runs[-1:])
    judgement = outcome.finding.judgement
    named = ", ".join(each.label for each in judgement.named)
    proof = outcome.proof.sentence if outcome.proof else ""
    return f"size {size:.3g}: {judgement.verdict} {named}; {proof}"


if __name__ == "__main__":
    sys.exit(main())
