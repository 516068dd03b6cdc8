# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a planner needs to know about the ground: margins with their uncertainty, a speed limit, and when to stop."""
