# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parts that the nodes share: parameters, life cycle, diagnostics, quality of service, disk threads."""
