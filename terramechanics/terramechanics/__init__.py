# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil, wheel, suspension, terrain profile and rover mechanics, in torch and without ROS."""
