# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How often find_missing_effect names an effect in tables of a wheel that lack none."""
