# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Writing of results: whole or not at all, and over nothing that is not ours."""
