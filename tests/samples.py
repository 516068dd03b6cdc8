# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How much a slow test takes: a short sample in `make test`, all of it in `make test-long`."""

import os
from typing import TypeVar

T = TypeVar("T")
LONG = os.environ.get("LONG_TESTS") == "1"


def sampled(short: T, full: T) -> T:
    """Return ``short``, or ``full`` in `make test-long`."""
    return full if LONG else short
