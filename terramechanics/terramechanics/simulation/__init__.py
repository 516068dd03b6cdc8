# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated rover: dynamics, commanded drives, sensors, and hooks for effects."""
