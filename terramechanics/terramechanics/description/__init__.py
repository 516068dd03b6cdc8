# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A rover as viewers draw it: the places of its wheels, and its URDF. Without torch."""
