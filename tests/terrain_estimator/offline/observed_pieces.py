# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A worker of tests: it writes to a file which pieces of a search it begins, and takes its time.

dask loads this module into the worker (--preload). The pieces themselves are the real ones.
"""

import os
import time
from pathlib import Path
from typing import Any

from terrain_estimator.offline import discovery_runs

SLOWNESS_S = 0.05


def dask_setup(_: Any) -> None:
    """Wrap the computation of this worker."""
    computed = vars(discovery_runs)["_packed"]

    def observed(work: Any, key: str, *others: Any) -> bytes:
        with Path(os.environ["PIECES_LOG"]).open("a", encoding="utf-8") as file:
            file.write(f"{key}\n")
        time.sleep(SLOWNESS_S)
        packed: bytes = computed(work, key, *others)
        return packed

    vars(discovery_runs)["_packed"] = observed
