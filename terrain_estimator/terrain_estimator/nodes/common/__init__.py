# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the nodes: parameters, life cycle, diagnostics, quality of service, disk."""
