# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The missing effect in measurements of one wheel on a testbed.

- ``cells``: measurements, replicates of one setting together, and the contact model's values.
- ``fit``: the most probable parameters of a hypothesis and its evidence.
- ``investigation``: all hypotheses, the verdict by the rule of drives (``evidence/verdict.py``),
  and cells that are held out.

c and tan phi are nuisances here: without drive torque they are not identified.
"""
