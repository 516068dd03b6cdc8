# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Plain C++ from an exported TorchScript model, and the compiled core that it makes."""
