# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Names of runs, by which their results are called."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rover_parameters.records import ConfigError
from terrain_estimator.bags import bag_name
from terrain_estimator.console.arguments import refuse_twice


def run_names(bags: Sequence[Path]) -> list[str]:
    """Return a name for each bag; bags of one name get those of their folders before it.

    ``monday/hills`` and ``tuesday/hills`` become ``monday_hills`` and ``tuesday_hills``. Raises
    ConfigError where a bag is given twice, or no folder tells two names apart.
    """
    refuse_twice(bags, "every bag is replayed once")
    folders = [bag.resolve().parent.parts[1:] for bag in bags]
    for depth in range(1 + max(map(len, folders), default=0)):
        names = [bag_name(bag) for bag in bags]
        shared = Counter(names)
        names = [
            "_".join([*parts[len(parts) - depth :], name]) if shared[name] > 1 else name
            for name, parts in zip(names, folders, strict=True)
        ]
        if len(set(names)) == len(names):
            return names
    raise ConfigError(
        f"{' and '.join(map(str, bags))}: their names cannot be told apart: replay them separately,"
        " each with its own --out"
    )
