# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Second forms of a model's functions: for the sizes and the path that a drive took."""
