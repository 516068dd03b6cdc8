# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A test of consistency for the status: does the last half minute fit physics and noise at all?"""
