# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Advice to planners: traction margins with uncertainty, a speed limit, when to stop."""
