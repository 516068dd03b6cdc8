# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the written pages share."""

from collections.abc import Iterable, Sequence

LICENCE = (
    "<!--\nSPDX-FileCopyrightText: 2026 The terrain_estimator authors\nSPDX-License-Identifier:"
    " Apache-2.0\n-->\n"
)


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    every = [head, ["---"] * len(head), *lines]
    return "".join("| " + " | ".join(line) + " |\n" for line in every)
