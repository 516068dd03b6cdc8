# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the dashboard node."""

from dataclasses import dataclass, field

from rover_parameters.parameters import INLINE
from rover_parameters.records import entry, number


@dataclass(frozen=True, slots=True)
class ShownConfig:
    """Parameters of :class:`terrain_estimator.dashboard.model.LiveModel`."""

    window_s: float = number(
        "length of the recent history", "s", 1.0, 3600.0, default=120.0, key="window"
    )
    points: int = number(
        "largest number of rows, in the recent history and in that of the whole drive",
        "1",
        10,
        5000,
        default=600,
    )


@dataclass(frozen=True, slots=True)
class DashboardConfig:
    """All parameters of the dashboard node."""

    port: int = number(
        "TCP port of the page; 0: a free one, which the log names", "1", 0, 65535, default=8090
    )
    address: str = entry(
        "address to listen on; 127.0.0.1: this machine only; 0.0.0.0: every machine that reaches"
        " it, without protection",
        "127.0.0.1",
    )
    rate: float = number("highest rate at which the page is updated", "Hz", 1.0, 20.0, default=5.0)
    shown: ShownConfig = field(default_factory=ShownConfig, metadata=INLINE)
