# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""ROS domains in which nobody else is."""

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager

from domain_coordinator import domain_id

# Never the domain of the test before: a killed process haunts its domain for some seconds.
_candidates = itertools.count(os.getpid() * 17)


@contextmanager
def own_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other test uses, in other runs on this machine neither."""
    with domain_id(lambda: next(_candidates) % 100 + 1) as reserved:
        yield reserved
