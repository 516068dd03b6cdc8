# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Copies of bags of object stores in folders of this machine."""

import hashlib
import tempfile
from collections.abc import Callable
from pathlib import Path

from fsspec import AbstractFileSystem

from terrain_estimator.fleet.sources import (
    FleetError,
    FoundBag,
    find_bags,
    is_here,
    place_of,
    reason_of,
)

_DIGITS = 8
"""Of the hash of an address, in the name of a copy."""


def copy_bag(bag: FoundBag, here: Path) -> None:
    """Copy a bag's files to ``here``, a new folder, or a new file for a bag of one."""
    system, path = place_of(bag.name)
    if bag.files:
        here.mkdir()
    for name in bag.files:
        system.get_file(f"{path}/{name}", str(here / name))
    if not bag.files:
        system.get_file(path, str(here))


def is_remote(source: str) -> bool:
    """Return whether a source is an address whose bags have to be copied. Raises FleetError."""
    return "://" in source and not is_here(place_of(source)[0])


def bring(source: str, folder: Path, troubled: Callable[[str], None]) -> Path:
    """Copy the bags at an address into a folder of its own in ``folder``; return that.

    A copy that is there with the sizes of the store's files is kept. Each appears whole or not at
    all. Raises FleetError where the store or the folder fails.
    """
    place = folder / _named(source)
    try:
        place.mkdir(parents=True, exist_ok=True)
        for bag in find_bags(source, troubled):
            _bring_bag(bag, place / (_named(bag.name) + ("" if bag.files else ".mcap")))
    except FleetError:
        raise
    except Exception as error:  # every store raises errors of its own
        raise FleetError(f"{source}: {reason_of(error)}") from error
    return place


def _bring_bag(bag: FoundBag, here: Path) -> None:
    if _is_whole(bag, here):
        return
    if here.exists():
        raise FleetError(f"{here}: is no whole copy of {bag.name}: move it away")
    with tempfile.TemporaryDirectory(prefix=".bring_", dir=here.parent) as new:
        copy_bag(bag, Path(new) / here.name)
        (Path(new) / here.name).rename(here)


def _named(address: str) -> str:
    """Return a name for a copy: the last part of the address, and the hash of all of it."""
    last = address.rstrip("/").rpartition("/")[2].removesuffix(".mcap")
    return f"{last}_{hashlib.sha256(address.encode()).hexdigest()[:_DIGITS]}"


def _is_whole(bag: FoundBag, here: Path) -> bool:
    system, path = place_of(bag.name)
    pairs = [(f"{path}/{name}", here / name) for name in bag.files] or [(path, here)]
    return all(_same_size(system, *pair) for pair in pairs)


def _same_size(system: AbstractFileSystem, there: str, here: Path) -> bool:
    return here.is_file() and here.stat().st_size == int(system.info(there)["size"])
