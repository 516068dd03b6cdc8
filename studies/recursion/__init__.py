# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The recursion that accumulates linearly and reads out nonlinearly: a trial beside the model's."""
