# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The calibrated thresholds of the verdict."""

import json
from importlib.resources import files

from terrain_estimator.discovery import Thresholds


def read_thresholds() -> Thresholds:
    """Return the thresholds that come with the package."""
    values = json.loads(
        (files("terrain_estimator.discovery.evidence") / "thresholds.json").read_text(
            encoding="utf-8"
        )
    )
    return Thresholds(values["anything"], values["share"], values["apart"])
