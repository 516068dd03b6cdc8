# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The exported model: regression rows, their noise, and the recursive posterior."""
