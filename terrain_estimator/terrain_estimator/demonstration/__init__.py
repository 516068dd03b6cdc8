# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated drives on real DDS: processes, verdicts and a figure."""
