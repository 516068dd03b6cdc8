# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Indent list items as the site's Markdown wants it: by four columns, not by the marker's width."""

import re

_MARKER = re.compile(r"(?:-|\d+\.) +")


def indented(text: str) -> str:
    """Return lists that are not nested with the content of each item indented by four."""
    lines: list[str] = []
    width = 0
    fenced = several = False
    for line in text.split("\n"):
        fenced ^= line.lstrip().startswith("```")
        marker = None if fenced else _MARKER.match(line)
        if marker:
            if several if width else lines[-1:] != [""]:
                lines.append("")
            several = False
            width = len(marker[0])
        elif line.strip() and not line.startswith(" " * width):
            width = 0
        several |= bool(width) and not line.strip()
        inside = width and not marker and line.strip()
        lines.append(f"    {line[width:]}" if inside else line)
    return "\n".join(lines)
