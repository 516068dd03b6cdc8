# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Description of the parameter that all managed nodes share."""

AUTO_START = (
    "configure and activate at the start; if false, wait for the services of a managed node"
)
