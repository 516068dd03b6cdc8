# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the estimator publishes where rover, ground, noise or physics are not its model's."""
