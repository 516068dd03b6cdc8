# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A million updates with faulty sensors and clocks, through estimator and messages: `make million`.

Every published covariance has to be symmetric and positive definite, every number finite or, where
its message allows it, NaN. Exit code 1 where one is not. The seeds are 1, 2, 3 and so on, one for
each estimator.
"""

import argparse
import multiprocessing
import os
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path

import torch

from docs.provenance import measured
from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.outcome import Outcome
from tests.faults.hostile import FaultyObservations
from tests.faults.page import PAGE, machine, replace_section
from tests.soundness import unsound

HEADING = "A million updates"
SECTION = """{measured}
Machine: {machine}; {minutes:.0f} min of processor time.

{updates} updates of {estimators} estimators on simulated drives. Values are replaced by
random ones, scaled by up to twelve orders of magnitude, or set to NaN, infinity, 0 and the largest
and smallest numbers. Stamps jump. Every update is converted to the messages that the node
publishes.

- Published numbers that are not finite (or NaN where the message does not allow it), covariances
  that are not symmetric and positive definite, intervals or probabilities out of order:
  **{unsound}**.
- Smallest 1 - |correlation| of a published covariance: {least:.1e}.
- Outcomes: {outcomes}.
- The clock was set back permanently {clock_resets} times.
"""


@dataclass(slots=True)
class Result:
    """Results of the updates of one estimator, or of several."""

    updates: int = 0
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    clock_resets: int = 0
    least: float = 1.0  # smallest 1 - |correlation| of a published covariance
    unsound: list[str] = field(default_factory=list)
    seconds: float = 0.0  # of processor time

    def __add__(self, other: "Result") -> "Result":
        return Result(
            self.updates + other.updates,
            self.outcomes + other.outcomes,
            self.clock_resets + other.clock_resets,
            min(self.least, other.least),
            self.unsound + other.unsound,
            self.seconds + other.seconds,
        )


def run(model: LoadedModel, updates: int, seed: int, longest: int = 200) -> Result:
    """Run ``updates`` updates of one estimator, and convert each to the published messages."""
    pipeline, types, result = Pipeline(model, EstimatorConfig()), Types(), Result()
    begin = time.process_time()
    for observation in islice(
        FaultyObservations(model.rover, model.metadata.soils[0], seed, longest).observations(),
        updates,
    ):
        answer = pipeline.answer(Conversion(observation.stamp_ns, observation))
        outgoing = answer.messages(types.make, pipeline.meta)
        result.updates += 1
        result.outcomes[answer.update.decision.outcome] += 1
        result.clock_resets += bool(answer.update.warnings)
        estimate = outgoing["terrain_estimate"]
        result.least = min(
            result.least,
            1.0
            - abs(estimate.covariance[1]) / (estimate.cohesion_stddev * estimate.tan_phi_stddev),
        )
        result.unsound += [
            f"seed {seed}, update {result.updates}: {text}"
            for message in outgoing.values()
            for text in unsound(message)
        ]
    result.seconds = time.process_time() - begin
    return result


def main() -> int:
    """Run all estimators, and keep the section of the page up to date; return the exit code."""
    options = _parser().parse_args()
    total, seeds = Result(), range(1, options.estimators + 1)
    with multiprocessing.get_context("spawn").Pool(options.jobs) as pool:
        results = pool.imap(partial(run_alone, options.updates // options.estimators), seeds)
        for estimators, result in enumerate(results, 1):
            total += result
            sys.stdout.write(
                f"{total.updates} updates, {total.seconds:.0f} s, unsound: {len(total.unsound)}\n"
            )
            sys.stdout.writelines(f"{line}\n" for line in result.unsound[:20])
            sys.stdout.flush()
            replace_section(options.page, HEADING, section(total, estimators))
    return int(bool(total.unsound))


def run_alone(updates: int, seed: int) -> Result:
    """Run one estimator of the installed model, in a process of its own."""
    torch.set_num_threads(1)
    return run(load_model(), updates, seed)


def section(total: Result, estimators: int) -> str:
    """Return the section of the page."""
    counts = sorted(total.outcomes.items())
    return SECTION.format(
        measured=measured("million"),
        machine=machine(),
        minutes=total.seconds / 60.0,
        updates=total.updates,
        estimators=estimators,
        unsound=len(total.unsound),
        least=total.least,
        outcomes=", ".join(f"{count} {outcome.name}" for outcome, count in counts),
        clock_resets=total.clock_resets,
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="million", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--updates",
        type=int,
        default=1_000_000,
        help="of all estimators together (default: %(default)s)",
    )
    parser.add_argument(
        "--estimators",
        type=int,
        default=100,
        help="each with a seed of its own (default: %(default)s)",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        help="processes at a time; the result does not depend on it",
    )
    parser.add_argument(
        "--page",
        type=Path,
        default=PAGE,
        help="whose section is replaced (default: docs/faults.md)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
