# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated hours of one rover from input to output messages without ROS, at low priority.

python -m benchmarks.soak.core ROVER HOURS SECONDS FILE      # samples go to FILE as a JSON list
"""

import dataclasses
import json
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
import psutil
import torch

from benchmarks.drives import long_drive
from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import Make
from terrain_estimator.update import Update
from tests.drives import STEP_NS, Event

SAMPLES = 1000
"""Samples in the whole allowed time; fewer where the hours are over before."""
NICENESS = 19
NORMAL = (Outcome.ACCEPTED, Outcome.ACCEPTED_PARTIALLY, Outcome.STANDSTILL, Outcome.GATED)
"""Outcomes of a healthy rover.

The velocity jumps where the drive is repeated; the gate may refuse it.
"""


@dataclass(frozen=True, slots=True)
class ProcessSample:
    """Sample of the process after some simulated hours."""

    hours: float
    memory_mb: float  # resident
    blocks: float  # that Python has allocated
    # processor time of a set of messages since the last sample, from making them to the answer
    set_us: float
    abnormal: float  # observations with another outcome than those of a healthy rover, so far
    not_finite: float  # updates with a number that is none, so far
    troubled: float  # messages that were lost, late or without a partner, so far


def run(
    pipeline: Pipeline, drive: Iterator[Event], make: Make, hours: float, seconds: float
) -> list[ProcessSample]:
    """Answer the sets of a drive until its ``hours`` or the ``seconds`` of wall time are over."""
    process, outcomes, not_finite = psutil.Process(), Counter(dict.fromkeys(Outcome, 0)), 0
    table = np.zeros(
        (SAMPLES + 2, len(dataclasses.fields(ProcessSample)))
    )  # at once, so that what is watched does not grow by the watching
    total, taken, begun_s, next_s = round(hours * 3600e9 / STEP_NS), 0, time.monotonic(), 0.0
    spent_s, since = time.thread_time(), 0
    answers = (answer for topic, _, message in drive for answer in pipeline.add(topic, message))
    for step, answer in enumerate(answers):
        answer.messages(make, pipeline.meta)
        outcomes[answer.update.decision.outcome] += 1
        not_finite += not finite(answer.update)
        past_s = time.monotonic() - begun_s
        if past_s < next_s and step + 1 < total and past_s < seconds:
            continue
        set_us = 1e6 * (time.thread_time() - spent_s) / (step + 1 - since)
        abnormal = sum(count for outcome, count in outcomes.items() if outcome not in NORMAL)
        memory_mb = process.memory_info().rss / 1e6
        done_hours, blocks = (step + 1) * STEP_NS / 3600e9, sys.getallocatedblocks()
        table[taken] = (
            done_hours,
            memory_mb,
            blocks,
            set_us,
            abnormal,
            not_finite,
            troubled(pipeline),
        )
        taken += 1
        if past_s >= seconds or step + 1 == total:
            break
        next_s = past_s + seconds / SAMPLES
        spent_s, since = time.thread_time(), step + 1
    return [ProcessSample(*row) for row in table[:taken].tolist()]


def finite(update: Update) -> bool:
    """Return whether all numbers of the estimate are finite."""
    estimate = update.estimate
    return all(math.isfinite(float(value)) for value in (*estimate.mean, *estimate.covariance.flat))


def troubled(pipeline: Pipeline) -> int:
    """Return the number of messages that were not paired in order."""
    return sum(
        count.unpaired + count.out_of_order + count.lost for count in pipeline.counters.values()
    )


def main(rover: str, hours: str, seconds: str, path: str) -> None:
    """Run one rover, whose number is the seed of its drive."""
    torch.set_num_threads(1)
    begun_s = time.monotonic()
    pipeline, make = Pipeline(load_model(), EstimatorConfig()), Types().make
    drive = long_drive(make, 3600.0 * float(hours), int(rover))
    first = next(drive)  # for which the drive is simulated
    os.nice(NICENESS)
    samples = run(
        pipeline,
        chain([first], drive),
        make,
        float(hours),
        float(seconds) - (time.monotonic() - begun_s),
    )
    Path(path).write_text(
        json.dumps([dataclasses.asdict(sample) for sample in samples]), encoding="utf-8"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
