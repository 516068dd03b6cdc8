# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Times and durations as people read them, as the live page shows them."""

import math
from datetime import UTC, datetime

SECOND_OF_2001 = 978_307_200.0
"""[s] Later stamps are times of day, earlier ones those of a simulation."""


def clock(stamp_s: float) -> str:
    """Return a time of day (UTC), or minutes and seconds of a simulation, to a tenth."""
    tenths = math.trunc(10.0 * stamp_s + math.copysign(1e-3, stamp_s))
    if stamp_s > SECOND_OF_2001:
        day = datetime.fromtimestamp(tenths // 10, UTC)
        return f"{day:%H:%M:%S}.{tenths % 10} UTC"
    seconds, sign = abs(tenths) // 10, "-" if tenths < 0 else ""
    return f"{sign}{seconds // 60}:{seconds % 60:02d}.{abs(tenths) % 10}"


def duration(seconds: float) -> str:
    """Return a duration in its two largest units, from seconds to days."""
    whole = max(round(seconds), 0)
    minutes, hours = whole // 60, whole // 3600
    if hours >= 48:
        return f"{hours // 24} d {hours % 24} h"
    if hours:
        return f"{hours} h {minutes % 60} min"
    return f"{minutes} min {whole % 60} s" if minutes else f"{whole} s"
