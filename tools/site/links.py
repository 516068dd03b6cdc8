# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Lead the links of the repository's pages to the pages and files of the site."""

import posixpath
import re
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "bags/README.md": "bags.md",
    "bags/foreign/README.md": "foreign_drives.md",
}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_SOURCES = {address: source for source, address in PAGES.items()}


def source_of(address: str) -> str:
    """Return the path in the repository of a page of the site."""
    return _SOURCES.get(address, f"docs/{address}")


def address_of(path: str) -> str:
    """Return the path in the site of a file of the repository."""
    if path in PAGES:
        return PAGES[path]
    return path.removeprefix("docs/") if path.startswith("docs/") else f"files/{path}"


def lead(text: str, page: str, copied: Callable[[str], None]) -> str:
    """Return a page's Markdown with the links of the site.

    `page` is the page's path in the site. `copied` is called with the path in the repository of
    each file that the site has to hold a copy of. A folder has no place in the site: its link
    becomes plain text. A link that leads nowhere stays as it is, for the generator to complain.
    """
    source = source_of(page)

    def led(match: re.Match[str]) -> str:
        mark, label, link = match.groups()
        target, hash_, anchor = link.partition("#")
        if not target or re.match(r"[a-z]+:", target):
            return match[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        if (ROOT / path).is_dir():
            return label
        if not (ROOT / path).exists():
            return match[0]
        address = address_of(path)
        if address.startswith("files/"):
            copied(path)
        relative = posixpath.relpath(address, posixpath.dirname(page) or ".")
        return f"{mark}[{label}]({relative}{hash_}{anchor})"

    return _LINK.sub(led, text)
