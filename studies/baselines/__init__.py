# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Peer methods behind one interface, batched over drives: what the estimator is measured against."""
