# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Long drives on one ground: do intervals hold where they have become narrow?"""
