# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Reference methods for the estimator, behind one interface and batched over drives."""
