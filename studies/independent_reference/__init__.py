# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A posterior of (c, tan phi) by the simulator's equations, without any row of the estimator."""
