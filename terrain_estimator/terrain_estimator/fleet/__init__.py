# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Any number of recordings through the estimator, on a cluster, with results as Parquet."""
