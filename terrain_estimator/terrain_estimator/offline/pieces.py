# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pieces of a search on the disk: one for each run that was read, evaluated or judged.

A search computes the same pieces in the same order whenever it is given the same command. So a
piece is known by the hash of what it is computed from, and no other state has to survive a kill.
"""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import torch

from terrain_estimator.discovery.evidence.expected import Stage
from terrain_estimator.discovery.evidence.isolability import Signature
from terrain_estimator.discovery.hypotheses.equations import Averages, Equations
from terrain_estimator.discovery.hypotheses.rows import Expansion
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.proof.held_out import GroundEstimate, Half
from terrain_estimator.discovery.proof.proof import Judged
from terrain_estimator.discovery.runs import Blocks, Signals
from terrain_estimator.files.journal_file import open_journal, remove_journal
from terrain_estimator.model.prior import Prior
from terrain_estimator.offline.reading_runs import ReadRun
from terramechanics.contact.scm import Rut
from terramechanics.terrain.soil import Soil

_APPLICATION = 0x7E44A1F2
_TABLES = "CREATE TABLE pieces (key TEXT PRIMARY KEY, result BLOB NOT NULL) WITHOUT ROWID"
_RECORDS: list[Callable[..., Any] | tuple[Callable[..., Any], str]] = [
    Averages, Blocks, Equations, Expansion, GroundEstimate, Half, Judged, Prior, ReadRun, Rut,
    Signals, Signature, Soil, Stage, Unknowns,
]  # fmt: skip
"""Types of which a result may consist, beside plain ones; nothing else is ever unpickled."""


def pack(result: Any) -> bytes:  # noqa: ANN401 (of _RECORDS)
    """Return a result as bytes that keep every number."""
    file = io.BytesIO()
    torch.save(result, file)
    return file.getvalue()


def unpack(packed: bytes) -> Any:  # noqa: ANN401 (of _RECORDS)
    """Return the result of bytes."""
    with torch.serialization.safe_globals(_RECORDS):
        return torch.load(io.BytesIO(packed), weights_only=True)


class Pieces:
    """The finished pieces of one search; use as a context manager."""

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
        """Open the file, or begin it.

        Raises JournalError where it is no such file, is in use, or of another ``identity``.
        """
        self._path = path
        self._base = open_journal(path, _APPLICATION, "search", _TABLES, identity)
        self.taken = 0
        """Number of pieces that were not computed again."""

    @property
    def finished(self) -> int:
        """Number of pieces on the disk."""
        return int(self._base.execute("SELECT count(*) FROM pieces").fetchone()[0])

    def get(self, key: str) -> bytes | None:
        """Return a finished piece."""
        row = self._base.execute("SELECT result FROM pieces WHERE key = ?", (key,)).fetchone()
        self.taken += row is not None
        return None if row is None else bytes(row[0])

    def put(self, key: str, result: bytes) -> None:
        """Keep a piece, whole on the disk when this returns."""
        self._base.execute("INSERT OR REPLACE INTO pieces VALUES (?, ?)", (key, result))

    def end(self) -> None:
        """Remove the file: the results of the search are on the disk."""
        self._base.close()
        remove_journal(self._path)

    def __enter__(self) -> Self:
        """Return the pieces themselves."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""
        self._base.close()
