# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Declarations of the parameters of all nodes, a file a node.

The nodes declare them from here; ``replay --params-file`` reads the estimator's.
"""
