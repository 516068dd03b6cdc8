# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The missing effect in measurements of one wheel on a testbed.

- ``cells``: measurements, replicates of one setting together, and the contact model's values.
- ``fit``: the most probable parameters of a hypothesis and its evidence.
- ``investigation``: all hypotheses, the verdict by the rule of drives (``evidence/verdict.py``),
  and cells that are held out.

c and tan phi are nuisances here: without drive torque they are not identified.
"""

from terrain_estimator.discovery.single_wheel.cells import Cells, Rig, Row, cells_of
from terrain_estimator.discovery.single_wheel.investigation import (
    WheelFinding,
    investigate_wheel,
    of_one_wheel,
    shown_by_one_wheel,
)

__all__ = [
    "Cells",
    "Rig",
    "Row",
    "WheelFinding",
    "cells_of",
    "investigate_wheel",
    "of_one_wheel",
    "shown_by_one_wheel",
]
