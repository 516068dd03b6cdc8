# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measured runs in CSV files, by a mapping that gives the meaning of their columns."""
