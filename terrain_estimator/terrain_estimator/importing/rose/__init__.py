# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Trials in the schema of RoSE Lab's "Rover Mobility in a Lunar Analogue Dataset" (CC BY 4.0)."""
