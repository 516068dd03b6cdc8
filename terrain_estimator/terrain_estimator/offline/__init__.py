# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs through the estimator: bags in; tables, reports and bags out."""
