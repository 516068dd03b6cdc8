# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated hours of one rover through the estimator without ROS, in a process of its own that gives way to all others.

python -m benchmarks.soak.core ROVER HOURS SECONDS FILE      # samples go to FILE as a JSON list
"""

import dataclasses
import json
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import torch

from benchmarks.drives import observations
from terrain_estimator.config import EstimatorConfig
from terrain_estimator.estimator import Estimator
from terrain_estimator.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update

SAMPLES = 1000
"""In the whole time that is allowed; fewer where the hours are over before."""
NICENESS = 10
PIECE_S = 30.0
"""[s] Of the drive that is repeated; it has to be simulated before anything can run."""
NORMAL = (Outcome.ACCEPTED, Outcome.ACCEPTED_PARTIALLY, Outcome.STANDSTILL, Outcome.GATED)
"""Outcomes of a healthy rover: where the repeated drive begins anew the velocity jumps, which the gate may refuse."""


@dataclass(frozen=True, slots=True)
class Sample:
    """The process after so many simulated hours."""

    hours: float
    memory_mb: float  # resident
    blocks: float  # that Python has allocated
    update_us: float  # processor time of an update since the sample before
    abnormal: float  # observations with another outcome than those of a healthy rover, so far
    not_finite: float  # updates with a number that is none, so far


def run(seen: Sequence[Observation], estimator: Estimator, hours: float, seconds: float) -> list[Sample]:
    """Repeat the observations of a drive with stamps that go on, until the hours are over or the ``seconds`` of wall time."""
    step_ns = seen[1].stamp_ns - seen[0].stamp_ns
    process, outcomes, not_finite = psutil.Process(), Counter(dict.fromkeys(Outcome, 0)), 0
    table = np.zeros((SAMPLES + 2, len(dataclasses.fields(Sample))))  # at once, so that what is watched does not grow by the watching
    wanted, taken, begun_s, next_s = round(hours * 3600e9 / step_ns), 0, time.monotonic(), 0.0
    spent_s, since = time.thread_time(), 0
    for step in range(wanted):
        here = seen[step % len(seen)]
        update = estimator.update(dataclasses.replace(here, stamp_ns=seen[0].stamp_ns + step * step_ns))
        outcomes[update.decision.outcome] += 1
        not_finite += not finite(update)
        past_s = time.monotonic() - begun_s
        if past_s < next_s and step + 1 < wanted and past_s < seconds:
            continue
        update_us = 1e6 * (time.thread_time() - spent_s) / (step + 1 - since)
        abnormal = sum(count for outcome, count in outcomes.items() if outcome not in NORMAL)
        memory_mb = process.memory_info().rss / 1e6
        table[taken] = ((step + 1) * step_ns / 3600e9, memory_mb, sys.getallocatedblocks(), update_us, abnormal, not_finite)
        taken += 1
        if past_s >= seconds:
            break
        next_s = past_s + seconds / SAMPLES
        spent_s, since = time.thread_time(), step + 1
    return [Sample(*row) for row in table[:taken].tolist()]


def finite(update: Update) -> bool:
    """Whether all numbers of the estimate are numbers."""
    estimate = update.estimate
    return all(math.isfinite(float(value)) for value in (*estimate.mean, *estimate.covariance.flat))


def main(rover: str, hours: str, seconds: str, path: str) -> None:
    """One rover, whose number is the seed of its drive."""
    torch.set_num_threads(1)
    begun_s = time.monotonic()
    config, model = EstimatorConfig(), load_model()
    seen = observations(model, PIECE_S, int(rover))
    os.nice(NICENESS)
    samples = run(seen, Estimator(model, config.core), float(hours), float(seconds) - (time.monotonic() - begun_s))
    Path(path).write_text(json.dumps([dataclasses.asdict(sample) for sample in samples]), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
