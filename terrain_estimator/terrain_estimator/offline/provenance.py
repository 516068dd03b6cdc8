# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Provenance of a result: versions of the software, and hashes of bags."""

import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rover_parameters.regular_file import open_regular

PACKAGES = ("terrain_estimator", "torch", "numpy", "scipy", "rosbags", "mcap")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages."""
    return {"python": platform.python_version()} | {name: _version(name) for name in PACKAGES}


def bag_sha256(bag: Path) -> str:
    """Return the SHA-256 of a bag's files in order, or a text where they cannot be read."""
    paths = sorted(bag.glob("*.mcap")) or sorted(bag.glob("*.db3*"))
    paths = paths if bag.is_dir() else [bag]
    if not paths:
        return "there is no file of messages"
    digest = hashlib.sha256()
    try:
        for path in paths:
            with open_regular(path) as file:
                while block := file.read(1 << 20):
                    digest.update(block)
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    return digest.hexdigest()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "from source, not installed"
