# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The search for a missing effect, judged on drives of a plant that this project did not write."""
