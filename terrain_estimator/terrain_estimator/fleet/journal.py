# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Journal of a fleet on the disk: which bags were found, and what came of each.

It is an SQLite file, since each result must be whole on the disk before the next one, and finished
bags must be found by name, size and content without a list of them in memory.
"""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from terrain_estimator.files.journal_file import JournalError, open_journal
from terrain_estimator.fleet.sources import FleetError, FoundBag
from terrain_estimator.fleet.task import EQUAL, FAILED, THIS, BagResult

_APPLICATION = 0x7E44A1F1
_TABLES = """
    CREATE TABLE bags (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        name TEXT UNIQUE NOT NULL,
        files TEXT NOT NULL,
        size INTEGER NOT NULL,
        sha256 TEXT,
        outcome TEXT,
        message TEXT,
        part INTEGER
    );
    CREATE INDEX by_size ON bags (size);
    CREATE INDEX by_content ON bags (sha256, name);
    CREATE INDEX waiting ON bags (number) WHERE outcome IS NULL;
    CREATE INDEX unwritten ON bags (number) WHERE outcome IS NOT NULL AND part IS NULL;
    CREATE INDEX by_part ON bags (part);
    CREATE TABLE contents (
        sha256 TEXT PRIMARY KEY,
        outcome TEXT NOT NULL,
        row TEXT NOT NULL,
        seconds BLOB NOT NULL
    ) WITHOUT ROWID;
    CREATE VIEW results AS
        SELECT b.name, b.sha256, b.message AS failure, b.outcome AS own, b.part,
            (SELECT min(o.name) FROM bags o WHERE o.sha256 = b.sha256) AS first,
            c.outcome, c.row, c.seconds
        FROM bags b LEFT JOIN contents c USING (sha256);
"""

_ALL_ROWS = """
    SELECT name, sha256, failure, first, outcome, row FROM results
    WHERE own IS NOT NULL ORDER BY name
"""
_ROWS_OF_PART = """
    SELECT name, sha256, failure, first, outcome, row FROM results WHERE part = ? ORDER BY name
"""
_ALL_SECONDS = """
    SELECT name, seconds FROM results
    WHERE own IS NOT NULL AND name = first AND length(seconds) > 0 ORDER BY name
"""
_SECONDS_OF_PART = """
    SELECT name, seconds FROM results
    WHERE part = ? AND name = first AND length(seconds) > 0 ORDER BY name
"""


class Journal:
    """The journal of one fleet; use as a context manager."""

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
        """Open the journal, or begin it.

        Raises:
            FleetError: the file is no journal, another process has it open, or it is of a fleet
                with another ``identity``; the message names what differs.
        """
        try:
            self._base = open_journal(path, _APPLICATION, "fleet", _TABLES, identity)
        except JournalError as error:
            raise FleetError(str(error)) from error
        # what failed for a passing reason is tried again
        self._base.execute(
            "UPDATE bags SET outcome = NULL, message = NULL, part = NULL WHERE outcome = 'failed'"
        )
        rows = self._base.execute(
            "SELECT ifnull(b.outcome, ''), c.outcome, count(*) FROM bags b"
            " LEFT JOIN contents c USING (sha256) GROUP BY 1, 2"
        )
        self.counts: Counter[str] = Counter()
        for own, of_content, count in rows:
            self.counts[own if own in {"", EQUAL, FAILED} else of_content] += count

    @property
    def found(self) -> int:
        """Number of bags that were found."""
        return self.counts.total()

    @property
    def left(self) -> int:
        """Number of bags without a result."""
        return self.counts[""]

    def add(self, bags: Iterable[FoundBag]) -> None:
        """Add bags as they were found; one whose size has changed loses its result."""
        self._base.execute("BEGIN")
        for bag in bags:
            known = self._base.execute(
                "SELECT b.size, ifnull(b.outcome, ''), c.outcome FROM bags b"
                " LEFT JOIN contents c USING (sha256) WHERE name = ?",
                (bag.name,),
            ).fetchone()
            if known and known[0] == bag.size:
                continue
            if known:
                self.counts[known[1] if known[1] in {"", EQUAL, FAILED} else known[2]] -= 1
            self.counts[""] += 1
            self._base.execute(
                "INSERT OR REPLACE INTO bags (name, files, size) VALUES (?, ?, ?)",
                (bag.name, json.dumps(bag.files), bag.size),
            )
        self._base.execute("COMMIT")

    def next(self, after: int) -> tuple[int, FoundBag] | None:
        """Return the number and the bag of the first one after a number without a result."""
        row = self._base.execute(
            "SELECT number, name, files, size FROM bags WHERE outcome IS NULL AND number > ?"
            " ORDER BY number LIMIT 1",
            (after,),
        ).fetchone()
        return (row[0], FoundBag(row[1], tuple(json.loads(row[2])), row[3])) if row else None

    def has_size(self, bag: FoundBag) -> bool:
        """Return whether another bag has the size of this one."""
        return bool(
            self._base.execute(
                "SELECT 1 FROM bags WHERE size = ? AND name != ? LIMIT 1", (bag.size, bag.name)
            ).fetchone()
        )

    def owner(self, sha256: str, name: str) -> str:
        """Return the name of a bag with a result of this content, empty where there is none."""
        row = self._base.execute(
            "SELECT name FROM bags WHERE sha256 = ? AND outcome IS NOT NULL AND name != ?"
            " ORDER BY name LIMIT 1",
            (sha256, name),
        ).fetchone()
        return str(row[0]) if row else ""

    def finish(self, number: int, result: BagResult) -> None:
        """Keep a result, whole on the disk when this returns."""
        self._base.execute("BEGIN")
        self._base.execute(
            "INSERT OR REPLACE INTO contents VALUES (?, ?, ?, ?)",
            (result.sha256, result.outcome, json.dumps(result.values), result.seconds),
        )
        self._end(number, result.outcome, sha256=result.sha256)
        self._base.execute("COMMIT")

    def finish_equal(self, number: int, sha256: str) -> None:
        """Keep that a bag has the content of another one."""
        self._end(number, EQUAL, sha256=sha256)

    def fail(self, number: int, message: str) -> None:
        """Keep why a bag could not be replayed this time."""
        self._end(number, FAILED, message=message)

    def _end(
        self, number: int, outcome: str, *, sha256: str | None = None, message: str | None = None
    ) -> None:
        self.counts[""] -= 1
        self.counts[outcome] += 1
        self._base.execute(
            "UPDATE bags SET outcome = ?, sha256 = ?, message = ? WHERE number = ?",
            (outcome, sha256, message, number),
        )

    def rows(self, part: int | None = None) -> Iterator[dict[str, Any]]:
        """Yield the row of every bag with a result, by name, or of those of one part.

        Of bags with equal content the first name has the estimate.
        """
        rows = self._base.execute(*_chosen(_ALL_ROWS, _ROWS_OF_PART, part))
        for name, sha256, failure, first, outcome, row in rows:
            values: dict[str, Any] = {"bag": name, "content_sha256": sha256}
            if row is None:
                yield values | {"outcome": FAILED, "message": failure}
            elif first == name:
                values |= {"outcome": outcome, **json.loads(row)}
                if message := values.get("message"):
                    values["message"] = message.replace(THIS, name)
                yield values
            else:
                yield values | {"outcome": EQUAL, "equal_to": first}

    def seconds(self, part: int | None = None) -> Iterator[tuple[str, bytes]]:
        """Yield the name and the packed seconds of every content, by name, or those of one part."""
        yield from self._base.execute(*_chosen(_ALL_SECONDS, _SECONDS_OF_PART, part))

    def begin_part(self) -> int:
        """Put all results that are in no part yet into the next one; return its number, or 0."""
        number = self.parts + 1
        taken = self._base.execute(
            "UPDATE bags SET part = ? WHERE outcome IS NOT NULL AND part IS NULL", (number,)
        ).rowcount
        return number if taken else 0

    @property
    def parts(self) -> int:
        """Number of the last part; 0 where all results are in the whole tables."""
        return int(self._base.execute("SELECT ifnull(max(part), 0) FROM bags").fetchone()[0])

    def end_parts(self) -> None:
        """Note that all results are in the whole tables."""
        self._base.execute("UPDATE bags SET part = 0 WHERE outcome IS NOT NULL")

    def __enter__(self) -> Self:
        """Return the journal itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""
        self._base.close()


def _chosen(of_all: str, of_part: str, part: int | None) -> tuple[str, tuple[int, ...]]:
    """Return a statement with its values."""
    return (of_all, ()) if part is None else (of_part, (part,))
