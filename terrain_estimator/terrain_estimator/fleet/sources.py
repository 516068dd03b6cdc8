# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bags in folders and object stores, found one after the other."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from fsspec import AbstractFileSystem
from fsspec.core import url_to_fs
from fsspec.implementations.local import LocalFileSystem

from terrain_estimator.bags import ENDINGS, METADATA_FILE, in_order

BARE = ".mcap"
"""Ending of a file that is a bag by itself."""


class FleetError(ValueError):
    """A fleet cannot run; the message names the place and the remedy."""


@dataclass(frozen=True, slots=True)
class FoundBag:
    """A bag as it was listed."""

    name: str  # absolute path, or URL
    files: tuple[str, ...]  # in the folder, metadata.yaml among them; empty for a bare file
    size: int  # bytes of its storage files

    @property
    def storage(self) -> tuple[str, ...]:
        """Names of the files with messages, in their order; empty for a bare file."""
        return tuple(file for file in self.files if file != METADATA_FILE)


def place_of(source: str) -> tuple[AbstractFileSystem, str]:
    """Return the file system of a path or URL, and the path in it. Raises FleetError."""
    try:
        # a cache of listings would grow with the number of bags
        system, path = url_to_fs(source, use_listings_cache=False)
    except (ValueError, ImportError) as error:
        raise FleetError(
            f"{source}: {error}; give a folder, an s3:// address, or install the fsspec package"
            " of this store"
        ) from error
    return system, str(path)


def is_here(system: AbstractFileSystem) -> bool:
    """Return whether a file system is that of this machine."""
    return isinstance(system, LocalFileSystem)


def full_name(source: str) -> str:
    """Return the absolute path or the URL of a source. Raises FleetError."""
    system, path = place_of(source)
    return path if is_here(system) else str(system.unstrip_protocol(path))


def find_bags(source: str, troubled: Callable[[str], None]) -> Iterator[FoundBag]:
    """Yield the bags at a path or URL, folder by folder in the order of their names.

    Only one folder's listing is in memory. Names that begin with a dot and links to folders are
    passed over. A folder below the source that cannot be listed is ``troubled`` and passed over,
    and so is a bag whose name is no text.

    Raises:
        FleetError: there is nothing at the source, or it cannot be listed.
    """
    system, top = place_of(source)
    name = _namer(system)
    try:
        found = system.info(top)
        if found["type"] == "file":
            yield FoundBag(name(top), (), int(found["size"]))
            return
        listing = _listed(system, top)
    except Exception as error:  # every store raises errors of its own
        raise FleetError(f"{source}: {reason_of(error)}: give a folder or a bag") from error
    folder, waiting = top, list[str]()
    while True:
        bags, inner = _sorted_out(folder, listing)
        for path, files, size in bags:
            if all(map(_is_text, (path, *files))):
                yield FoundBag(name(path), files, size)
            else:
                troubled(f"{name(path)!a}: the name is not UTF-8: rename it")
        waiting += reversed(inner)
        listing = []
        while waiting and not listing:
            folder = waiting.pop()
            try:
                listing = _listed(system, folder)
            except Exception as error:  # noqa: BLE001 - likewise
                troubled(f"{name(folder)}: {reason_of(error)}: its bags are left out")
        if not listing:
            return


def reason_of(error: Exception) -> str:
    """Return the reason of an error of a file system, without the names of others around it."""
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def _namer(system: AbstractFileSystem) -> Callable[[str], str]:
    return str if is_here(system) else system.unstrip_protocol


def _listed(system: AbstractFileSystem, folder: str) -> list[Mapping[str, Any]]:
    return [
        entry
        for entry in system.ls(folder, detail=True)
        if entry["name"].rstrip("/") != folder.rstrip("/")  # an object store's mark of the folder
    ]


def _sorted_out(
    folder: str, entries: Iterable[Mapping[str, Any]]
) -> tuple[list[tuple[str, tuple[str, ...], int]], list[str]]:
    """Return the bags in a folder, as path, files and size, and the folders to look into."""
    entries = sorted(entries, key=lambda entry: str(entry["name"]))
    shown = [entry for entry in entries if not _last(entry["name"]).startswith(".")]
    sizes = {_last(entry["name"]): int(entry["size"] or 0) for entry in shown if _is_file(entry)}
    storage = in_order(name for name in sizes if name.endswith(ENDINGS))
    if METADATA_FILE in sizes:
        return [(folder, (METADATA_FILE, *storage), sum(sizes[name] for name in storage))], []
    inner = [str(entry["name"]) for entry in shown if entry["type"] == "directory"]
    bare = [name for name in storage if name.endswith(BARE)]
    # a recording that was killed has no metadata.yaml
    numbered = re.compile(rf"{re.escape(_last(folder))}_\d+{re.escape(BARE)}")
    if bare and all(numbered.fullmatch(name) for name in bare):
        return [(folder, tuple(bare), sum(sizes[name] for name in bare))], inner
    return [(f"{folder.rstrip('/')}/{name}", (), sizes[name]) for name in sorted(bare)], inner


def _is_text(name: str) -> bool:
    """Return whether a name can be kept in tables: on a disk it can be any bytes."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _last(path: str) -> str:
    return path.rstrip("/").rpartition("/")[2]


def _is_file(entry: Mapping[str, Any]) -> bool:
    """Return whether an entry is a file or a link; a link to a folder has no ending of a bag."""
    return bool(entry["type"] == "file" or entry.get("islink"))
