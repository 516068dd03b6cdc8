# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Estimation from recordings: bags in; tables, reports and bags out."""
