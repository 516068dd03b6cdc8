# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""ROS domains in which nobody else is."""

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager

from domain_coordinator import domain_id

DOMAINS = 100
_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_numbers = itertools.count(os.getpid() * 17)


def candidates(numbers: Iterator[int], worker: int, workers: int) -> Iterator[int]:
    """Yield domains from 1 to DOMAINS, one for each number, that no other worker of a run gets.

    Neighbouring numbers have other domains: a killed process haunts its domain for some seconds,
    so neither the test before nor one that another worker has just ended may have had it.
    """
    for number in numbers:
        yield number % (DOMAINS // workers) * workers + worker + 1


_candidates = candidates(_numbers, _worker, _workers)


@contextmanager
def own_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other test uses, in other runs on this machine neither."""
    with domain_id(lambda: next(_candidates)) as reserved:
        yield reserved
