# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator's state as the bytes of a file, from which a node that starts again goes on.

One line of JSON describes the file (version, model, size and sha256 of the rest); NumPy's npz of
plain arrays follows, which is never unpickled. A file that is cut, changed, of another version or
of another model is refused before its arrays are read.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

VERSION = 5
READABLE = (4, VERSION)
"""Version 4 has no tracks of wheels: a state of it goes on without them."""
_FORMAT = "terrain_estimator state"
_BEGINNING = json.dumps({"format": _FORMAT}).removesuffix("}").encode()
BEGINNING_SIZE = len(_BEGINNING)
LARGEST_FILE = 16 << 20
"""[bytes] States of six wheels have 0.1 % of it."""

Arrays: TypeAlias = Mapping[str, NDArray[Any]]
"""Plain arrays by name."""


class StateFileError(ValueError):
    """A state is missing, damaged, or another model's; the message names file and remedy."""


def pack_state(arrays: Arrays, model_sha256: str) -> bytes:
    """Return the content of a state file."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    payload = buffer.getvalue()
    header = {
        "format": _FORMAT,
        "version": VERSION,
        "model_sha256": model_sha256,
        "size": len(payload),
        "sha256": hashlib.sha256(payload).hexdigest(),
    }
    return json.dumps(header).encode() + b"\n" + payload


def unpack_state(content: bytes, model_sha256: str, where: str) -> dict[str, NDArray[Any]]:
    """Return the arrays of a state file. Raises StateFileError that begins with ``where``."""
    line, _, payload = content.partition(b"\n")
    header = _header(line, where)
    version = header.get("version") if header.get("version") in READABLE else VERSION
    expected = {"format": _FORMAT, "version": version, "model_sha256": model_sha256}
    advice = "start without it, from the prior"
    for key, value in expected.items():
        if header.get(key) != value:
            raise StateFileError(
                f"{where}: {key} is {header.get(key)!r}, expected {value!r}: {advice}"
            )
    if (
        header.get("size") != len(payload)
        or header.get("sha256") != hashlib.sha256(payload).hexdigest()
    ):
        raise StateFileError(
            f"{where}: is damaged, {len(payload)} bytes are not the {header.get('size')} of its"
            f" sha256: {advice}"
        )
    try:
        return _arrays(payload)
    except Exception as error:  # zipfile, its decompressors and NumPy raise many kinds
        if type(error) is MemoryError:  # which NumPy's own, of a wrong shape, is not
            raise
        raise StateFileError(
            f"{where}: is no archive of plain arrays ({error}): {advice}"
        ) from error


def _arrays(payload: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of an npz that is not larger than a state file may be.

    Raises the errors of its readers.
    """
    with zipfile.ZipFile(io.BytesIO(payload)) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
    if unpacked > LARGEST_FILE:
        raise ValueError(f"unpacks to {unpacked} bytes")
    with np.load(io.BytesIO(payload), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def never_was_state(beginning: bytes) -> bool:
    """Return whether a file that begins so never was a state.

    One that was begins as one, or is empty or all zeros, as a power cut may leave it. ``beginning``
    are the first BEGINNING_SIZE bytes of the file.
    """
    return beginning != _BEGINNING and any(beginning)


def _header(line: bytes, where: str) -> dict[str, Any]:
    try:
        header = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise StateFileError(f"{where}: is no state file: its first line is no JSON") from error
    return header if isinstance(header, dict) else {}
