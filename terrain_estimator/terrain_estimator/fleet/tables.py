# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of a fleet in Parquet: small parts as results come, whole tables by name at the end."""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from terrain_estimator.files.atomic import replacing
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.fleet import seconds
from terrain_estimator.fleet.journal import Journal

BAGS, SECONDS, PARTS = "bags.parquet", "seconds.parquet", "parts"
BAG_COLUMNS = pa.schema(
    [
        ("bag", pa.string()),
        ("content_sha256", pa.string()),
        ("outcome", pa.string()),
        ("equal_to", pa.string()),
        ("status", pa.string()),
        ("cohesion_pa", pa.float64()),
        ("tan_phi", pa.float64()),
        ("cohesion_sd_pa", pa.float64()),
        ("tan_phi_sd", pa.float64()),
        ("correlation", pa.float64()),
        ("estimates", pa.int64()),
        ("used", pa.int64()),
        ("refused", pa.int64()),
        ("seconds_taken", pa.int64()),
        ("seconds_refused", pa.int64()),
        ("span_s", pa.float64()),
        ("message", pa.string()),
        ("model_sha256", pa.string()),
        ("configuration_sha256", pa.string()),
        ("runtime", pa.string()),
    ]
)
SECOND_COLUMNS = pa.schema([("bag", pa.string()), *seconds.COLUMNS])
_ROWS = 2000  # of bags in a group
_SECONDS = 100_000  # in a group, at least


class FleetTables:
    """The tables of a fleet in a folder of results."""

    def __init__(self, results: ResultFolder, journal: Journal) -> None:
        """Write again the parts that a kill kept from the disk."""
        self._results, self._journal = results, journal
        for number in range(1, journal.parts + 1):
            if not all(self._part(name, number).exists() for name in (BAGS, SECONDS)):
                self._write_part(number)

    def add_part(self) -> None:
        """Write the results since the last call as one more part. Raises OutputError."""
        if number := self._journal.begin_part():
            self._write_part(number)

    def complete(self) -> None:
        """Write the whole tables, in the order of the names, and remove the parts.

        Nothing is done where they are complete already. Raises OutputError.
        """
        self.add_part()
        if not self._journal.parts and (self._results.path / BAGS).exists():
            return
        with self._results.renewing(BAGS, SECONDS, PARTS) as new:
            self._write(new / BAGS, new / SECONDS, None)
        self._journal.end_parts()

    def _part(self, table: str, number: int) -> Path:
        return self._results.path / PARTS / table / f"{number:06d}.parquet"

    def _write_part(self, number: int) -> None:
        names = []
        for table in (BAGS, SECONDS):
            place = self._part(table, number)
            place.parent.mkdir(parents=True, exist_ok=True)
            names.append(str(place.relative_to(self._results.path)))
        with self._results.renewing(*names) as new:
            for name in names:
                (new / name).parent.mkdir(parents=True)
            self._write(new / names[0], new / names[1], number)

    def _write(self, bags: Path, second: Path, part: int | None) -> None:
        _write(bags, BAG_COLUMNS, _bag_groups(self._journal.rows(part)))
        _write(second, SECOND_COLUMNS, _second_groups(self._journal.seconds(part)))


def _write(path: Path, columns: pa.Schema, groups: Iterable[pa.Table]) -> None:
    with replacing(path) as file, pq.ParquetWriter(file, columns, compression="zstd") as writer:
        for group in groups:
            writer.write_table(group)


def _bag_groups(rows: Iterator[dict[str, Any]]) -> Iterator[pa.Table]:
    while group := list(islice(rows, _ROWS)):
        yield pa.Table.from_pylist(group, schema=BAG_COLUMNS)


def _second_groups(packed: Iterator[tuple[str, bytes]]) -> Iterator[pa.Table]:
    """Yield groups of whole bags; only one group is in memory."""
    waiting: list[pa.Table] = []
    for name, content in packed:
        table = seconds.unpacked(content)
        waiting.append(table.add_column(0, "bag", pa.array([name] * len(table), pa.string())))
        if sum(map(len, waiting)) >= _SECONDS:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)
