# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of written pages."""

from collections.abc import Iterable, Sequence


def licence(command: str) -> str:
    """Return the comment at the top of a page that ``make COMMAND`` writes."""
    return (
        "<!--\nSPDX-FileCopyrightText: 2026 The terrain_estimator authors\n"
        "SPDX-License-Identifier: Apache-2.0\n\n"
        f"Written by `make {command}`: run it again, do not edit.\n-->\n"
    )


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    every = [head, ["---"] * len(head), *lines]
    return "".join("| " + " | ".join(line) + " |\n" for line in every)
