# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hashes of values by their content, equal in every process."""

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping
from functools import cache, partial
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from torch import Tensor

_SOURCES = ("terrain_estimator", "terramechanics", "rover_parameters")


def digest(value: Any) -> str:  # noqa: ANN401 (whatever a task holds)
    """Return the SHA-256 of a value of plain types, tensors, records and functions of modules.

    Raises TypeError for any other type: what it would leave out could make two values equal.
    """
    sums = hashlib.sha256()
    for each in _parts(value):
        sums.update(each)
    return sums.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:  # noqa: ANN401 (see digest)
    match value:
        case None | bool() | int() | str() | Path():
            yield _framed(f"{type(value).__name__} {value}".encode())
        case float():
            yield _framed(f"float {value.hex()}".encode())
        case bytes():
            yield _framed(value)
        case Tensor():
            yield _framed(f"{value.dtype} {tuple(value.shape)}".encode())
            yield value.detach().contiguous().numpy().tobytes()
        case partial():
            yield from _all("partial", value.func, value.args, value.keywords)
        case Mapping():
            yield from _all("mapping", *(part for pair in value.items() for part in pair))
        case list() | tuple():
            yield from _all(type(value).__qualname__, *value)
        case _ if dataclasses.is_dataclass(value) and not isinstance(value, type):
            fields = [getattr(value, field.name) for field in dataclasses.fields(value)]
            yield from _all(f"{type(value).__module__}.{type(value).__qualname__}", *fields)
        case _ if callable(value) and "<" not in getattr(value, "__qualname__", "<"):
            yield _framed(f"{value.__module__}.{value.__qualname__}".encode())
        case _:
            raise TypeError(f"a {type(value).__name__} has no hash by its content")


def _all(name: str, *values: Any) -> Iterator[bytes]:
    yield _framed(f"{name} {len(values)}".encode())
    for each in values:
        yield from _parts(each)


def _framed(content: bytes) -> bytes:
    """Return the content behind its length, so that no two sequences have the same bytes."""
    return len(content).to_bytes(8, "little") + content


@cache
def code_sha256() -> str:
    """Return the SHA-256 of the sources on which a result depends."""
    sums = hashlib.sha256()
    for package in _SOURCES:
        for name, content in sorted(_sources(files(package), package)):
            sums.update(_framed(name.encode()) + _framed(content))
    return sums.hexdigest()


def _sources(folder: Traversable, name: str) -> Iterator[tuple[str, bytes]]:
    for each in folder.iterdir():
        below = f"{name}/{each.name}"
        if each.is_dir():
            yield from _sources(each, below)
        elif each.name.endswith((".py", ".json", ".yaml")):
            yield below, each.read_bytes()
