# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the recorder node."""

from dataclasses import dataclass

from rover_parameters.records import ConfigError, entry, number
from terrain_estimator.config.auto_start import AUTO_START
from terrain_estimator.topics import RECORDED_TOPICS

LEAST_SIZE_MB = 1.0
"""Each file begins with the definitions of its topics, some 40 kB."""
LEAST_DURATION_S = 1.0


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """All parameters of the recorder node."""

    auto_start: bool = entry(AUTO_START, default=True)

    output: str = entry(
        "folder of the bag, must not exist; empty: bags/<UTC time>, with -2, -3 if that exists", ""
    )
    topics: str = entry(
        "names of the topics, as a list or separated by spaces; relative names are in the node's"
        " namespace",
        " ".join(RECORDED_TOPICS),
    )
    fsync_interval_s: float = number(
        "time between two fsync calls, which a power cut may cost; a kill costs nothing",
        "s",
        0.01,
        60.0,
        default=1.0,
        key="fsync_interval",
    )
    split_size_mb: float = number(
        "size before compression at which the next file begins, at least 1; 0: no limit",
        "MB",
        0.0,
        1e6,
        default=0.0,
        key="split.size",
    )
    split_duration_s: float = number(
        "span of log times at which the next file begins, at least 1; 0: no limit",
        "s",
        0.0,
        1e6,
        default=0.0,
        key="split.duration",
    )

    def __post_init__(self) -> None:
        """Refuse splits that would give a file for every few messages."""
        for name, value, unit, least in (
            ("size", self.split_size_mb, "MB", LEAST_SIZE_MB),
            ("duration", self.split_duration_s, "s", LEAST_DURATION_S),
        ):
            if 0.0 < value < least:
                raise ConfigError(
                    f"parameter split.{name}: {value:g} {unit} is too little for a file: give"
                    f" {least:g} or more, or 0 for no limit"
                )
