# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Exceptions of this layer."""


class BagError(ValueError):
    """A bag cannot be read or written; the message names the file and the remedy."""


class BagExistsError(BagError):
    """The folder of a new bag exists already."""
