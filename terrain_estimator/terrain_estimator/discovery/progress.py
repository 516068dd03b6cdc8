# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of what a long search reports its progress to."""

from typing import Protocol


class ProgressCallback(Protocol):
    """A function that is told the share of the work that is done, 0 to 1, and what comes next."""

    def __call__(self, share: float, label: str, /) -> None:
        """Take note of it."""
