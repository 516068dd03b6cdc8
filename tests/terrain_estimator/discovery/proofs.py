# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Share of the held-out gap that the right name closes.

``python -m tests.terrain_estimator.discovery.proofs [NAME ...]``

Of each case's five drives four tell the size of the effect and the last one is held out. The law
that is hidden is another one than the library's of the same name.
"""

import argparse
import dataclasses
import sys

import torch

from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.proof.proof import Proof, prove
from terrain_estimator.discovery.runs import RecordedRun, cut
from terrain_estimator.model.packing import pack_measurement
from terramechanics.presets import load_soil
from terramechanics.simulation.sample import TIME_STEP, Measurement
from terramechanics.vehicle.rover import Rover
from tests.hidden.cases import Case, Plan, draw_cases
from tests.hidden.generators import GENERATORS
from tests.hidden.matters import axle_means

SEED = 52_000


def run_of(drive: Measurement, rover: Rover, name: str) -> RecordedRun:
    """Return one measured drive as a run: axle means, torque without the wheels' own inertia."""
    means = axle_means(drive, rover.axles)
    gain = torch.diff(means.wheel_rate, dim=0, prepend=means.wheel_rate[:1]) / TIME_STEP
    means = dataclasses.replace(means, torque=means.torque - rover.wheel_inertia * gain)
    batch = Measurement(
        **{
            item.name: getattr(means, item.name).unsqueeze(0)
            for item in dataclasses.fields(Measurement)
        }
    )
    packed = pack_measurement(batch)[0]
    return RecordedRun(
        name,
        packed,
        means.wheel_rate,
        TIME_STEP * torch.arange(packed.shape[0], dtype=torch.float64),
    )


def proof_of(case: Case, name: str) -> Proof:
    """Return the proof of ``name`` on the last drive, fitted to the others."""
    nominal = nominal_of(case.rover, load_soil(case.truth.soil))
    with torch.inference_mode():
        runs = [
            cut(run_of(drive, case.rover, f"run {k}"), nominal.contact)
            for k, drive in enumerate(case.drives)
        ]
        study = Study(nominal, runs[:-1])
        best = max(
            (study.explain(each) for each in singles((name,))),
            key=lambda each: each.fit.log_evidence,
        )
        return prove(nominal, study.refine(best), runs[-1:])


def main() -> None:
    """Print a line for every case."""
    torch.set_num_threads(1)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", default=[name for name, hidden in GENERATORS.items() if hidden.known]
    )
    parser.add_argument("--cases", type=int, default=1, help="of each name")
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args()
    columns = (
        "rollouts: before",
        "after",
        "floor",
        "closed",
        "next second: before",
        "after",
        "added",
    )
    sys.stdout.write(f"{'hidden':>16}" + "".join(f"{column:>21}" for column in columns) + "\n")
    for name in options.names:
        for case in draw_cases(Plan(((name, 1.0),)), options.cases, options.seed):
            proof = proof_of(case, name)
            gap, step = proof.gap, proof.one_step_gap
            assert gap is not None
            closed = "no gap" if gap.closed is None else f"{gap.closed:.0%}"
            numbers = [
                f"{gap.before:.2f}",
                f"{gap.after:.2f}",
                f"{gap.noise_floor:.2f}",
                closed,
                f"{step.before:.2f}",
                f"{step.after:.2f}",
            ]
            sys.stdout.write(
                f"{name:>16}"
                + "".join(f"{each:>21}" for each in [*numbers, "yes" if proof.added else "no"])
                + "\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
