# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A worker of tests: it writes to a file which bags it begins and ends, and takes its time.

dask loads this module into the worker (--preload). The replay itself is the real one.
"""

import os
import time
from pathlib import Path
from typing import Any

from terrain_estimator.fleet import task
from terrain_estimator.offline.replay import estimate


def _note(what: str, bag: Path) -> None:
    with Path(os.environ["FLEET_LOG"]).open("a", encoding="utf-8") as file:
        file.write(f"{what} {bag.name}\n")


def dask_setup(_: Any) -> None:
    """Wrap the replay of this worker."""

    def observed(bag: Path, *arguments: Any, **options: Any) -> Any:
        _note("begin", bag)
        time.sleep(float(os.environ["FLEET_SLOWNESS"]))
        result = estimate(bag, *arguments, **options)
        _note("end", bag)
        return result

    vars(task)["estimate"] = observed
