# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of rosbag2's format: definitions, metadata, quality of service, types."""
