# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS domain for each test."""

from tests.system.conftest import domain_id  # noqa: F401
