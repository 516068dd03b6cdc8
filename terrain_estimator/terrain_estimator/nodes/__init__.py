# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes, the only importers of rclpy in this package."""
