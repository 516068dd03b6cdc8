# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Files of results that outlive a kill: SQLite, for one job at a time, known by its arguments."""

import json
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PATIENCE_S = 1.0
"""[s] Time after which a journal that another process has open is an error."""
_IDENTITY = "CREATE TABLE identity (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID"
_LONGEST = 200  # characters of a value in an error


class JournalError(ValueError):
    """A journal cannot be used; the message names it and the remedy."""


def open_journal(
    path: Path, kind: int, job: str, tables: str, identity: Mapping[str, Any]
) -> sqlite3.Connection:
    """Open the journal of a ``job``, such as "fleet", or begin it with these ``tables``.

    A statement that has ended is whole on the disk after a kill; a power cut may cost the last
    ones, not the file. Nobody else can open it meanwhile.

    Raises:
        JournalError: the file is no journal of this ``kind``, another process has it open, or it is
            that of a job with another ``identity``; the message names what differs.
    """
    base = sqlite3.connect(path, timeout=PATIENCE_S, isolation_level=None)
    try:
        _begin(base, path, kind, job, tables, {k: json.dumps(v) for k, v in identity.items()})
    except sqlite3.OperationalError as error:
        base.close()
        raise JournalError(
            f"{path}: {error}: another {job} works in this folder, or the disk refuses it:"
            " wait, or give another folder with --out"
        ) from error
    except sqlite3.DatabaseError as error:
        base.close()
        raise JournalError(
            f"{path}: is no journal of a {job} ({error}): give another folder with --out"
        ) from error
    except JournalError:
        base.close()
        raise
    return base


def _begin(
    base: sqlite3.Connection,
    path: Path,
    kind: int,
    job: str,
    tables: str,
    identity: Mapping[str, str],
) -> None:
    run = base.execute
    run("PRAGMA locking_mode = EXCLUSIVE")
    run("PRAGMA journal_mode = WAL")
    run("PRAGMA synchronous = NORMAL")
    run("BEGIN EXCLUSIVE")
    found = run("PRAGMA application_id").fetchone()[0]
    if found == 0 and not run("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        run(f"PRAGMA application_id = {kind}")
        for statement in filter(str.strip, [*tables.split(";"), _IDENTITY]):
            run(statement)
        base.executemany("INSERT INTO identity VALUES (?, ?)", identity.items())
    elif found != kind:
        raise JournalError(f"{path}: is no journal of a {job}: give another folder with --out")
    known = dict(run("SELECT name, value FROM identity").fetchall())
    if other := sorted(
        name for name in known.keys() | identity if known.get(name) != identity.get(name)
    ):
        told = "; ".join(
            f"{name} was {_short(known.get(name))}, is {_short(identity.get(name))}"
            for name in other
        )
        raise JournalError(
            f"{path.parent}: holds results of another {job} ({told}): give the same arguments, or"
            " another folder with --out"
        )
    run("COMMIT")


def _short(value: str | None) -> str:
    if value is None:
        return "not given"
    return value if len(value) <= _LONGEST else f"{value[:_LONGEST]}..."


def remove_journal(path: Path) -> None:
    """Remove a closed journal of ours, with what SQLite keeps beside it."""
    for each in (path, *(path.with_name(f"{path.name}{end}") for end in ("-wal", "-shm"))):
        each.unlink(missing_ok=True)
