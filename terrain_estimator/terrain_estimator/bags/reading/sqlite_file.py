# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read one SQLite file of a bag (storage sqlite3), through the rosbags library."""

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

import apsw
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from rover_parameters.records import ConfigError
from rover_parameters.yaml_files import parse_yaml
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.definitions import installed_definition
from terrain_estimator.bags.format.metadata import TimeSpan
from terrain_estimator.bags.reading.contents import Contents
from terrain_estimator.bags.reading.records import LARGEST_CONTENTS, StoredMessage

MAGIC = b"SQLite format 3\x00"
TABLES = ("schema", "metadata", "topics", "message_definitions", "messages")
MOST_TOPICS = 10_000
LONGEST_TEXT = 1 << 20
"""[bytes] of a name, a definition or a quality of service."""
_AGAIN = "copy the file again from its source"
_ERRORS = (apsw.Error, sqlite3.Error, ReaderError, UnicodeDecodeError, KeyError, TypeError)


class SqliteFile:
    """An open SQLite file of rosbag2, with the contents in the terms of :class:`McapFile`.

    A file of before ROS 2 Jazzy has no message definitions: the installed ones stand in.

    Raises:
        BagError: no bag, not closed, damaged, or built so that reading could have no end.
    """

    def __init__(self, path: Path) -> None:
        """Check the file's tables, then open it and read its contents."""
        self.path = path
        self.contents = Contents(finished=True)
        _refuse_unclosed(path)
        # rosbags makes a URI of the path
        self._reader = Sqlite3Reader(Path(quote(str(path.resolve()))))
        try:
            qos = _checked_tables(path)
            self._reader.open()
            self._limit()
            self._read_contents(qos)
        except ConfigError as error:
            self.close()
            raise BagError(f"{path} is damaged: quality of service: {error}; {_AGAIN}") from error
        except _ERRORS as error:
            self.close()
            raise self._damaged(error) from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        if self._reader.dbconn is not None:
            self._reader.close()

    def messages(self, wanted: frozenset[int]) -> Iterator[StoredMessage]:
        """Yield the messages of the wanted channels by log time; SQLite sorts them."""
        chosen = [each for each in self._reader.connections if each.id in wanted]
        if not chosen:
            return
        try:
            for connection, time_ns, data in self._reader.messages(chosen):
                if type(time_ns) is not int or type(data) is not bytes:
                    raise TypeError(
                        f"a message of {connection.topic} has a {type(time_ns).__name__} as its"
                        f" time and a {type(data).__name__} as its data"
                    )
                yield StoredMessage(time_ns, connection.id, time_ns, data)
        except _ERRORS as error:
            raise self._damaged(error) from error

    def _damaged(self, error: Exception) -> BagError:
        return BagError(f"{self.path} is damaged ({type(error).__name__}: {error}); {_AGAIN}")

    def _limit(self) -> None:
        """Refuse values that need more memory than a chunk of an MCAP file may."""
        if self._reader.dbconn is not None:
            self._reader.dbconn.limit(apsw.SQLITE_LIMIT_LENGTH, LARGEST_CONTENTS)

    def _read_contents(self, qos: Mapping[int, str]) -> None:
        undefined: set[str] = set()
        for each in self._reader.connections:
            self.contents.schemas[each.id] = self._schema(each, undefined)
            self.contents.channels[each.id] = _channel(each, qos.get(each.id, ""))
            self.contents.counts[each.id] = each.msgcount
        known = self._reader.metadata
        if known.message_count:
            # rosbags counts the end as one beyond the last message
            self.contents.span = TimeSpan(known.start_time, known.end_time - 1, known.message_count)
        if undefined:
            names = ", ".join(sorted(undefined))
            self.contents.notes.append(
                f"{self.path} has no definition of {names}: the installed one stands in"
            )

    def _schema(self, connection: Connection, undefined: set[str]) -> Schema:
        text, encoding = connection.msgdef.data, ""
        if connection.msgdef.format == MessageDefinitionFormat.MSG:
            encoding = SchemaEncoding.ROS2
        elif connection.msgdef.format == MessageDefinitionFormat.NONE:
            try:
                text = installed_definition(connection.msgtype).text
            except BagError:
                text = ""
            else:
                encoding = SchemaEncoding.ROS2
                undefined.add(connection.msgtype)
        return Schema(
            id=connection.id, name=connection.msgtype, encoding=encoding, data=text.encode()
        )


def _channel(connection: Connection, qos: str) -> Channel:
    extra: Any = connection.ext
    coding = extra.serialization_format
    return Channel(
        id=connection.id,
        topic=connection.topic,
        schema_id=connection.id,
        message_encoding=MessageEncoding.CDR if coding == "cdr" else coding,
        metadata={"offered_qos_profiles": qos, "topic_type_hash": connection.digest},
    )


def _refuse_unclosed(path: Path) -> None:
    """Refuse a file whose last messages are still in a journal.

    SQLite would change the file and its journal, which only their owner should do.
    """
    for ending in ("-wal", "-journal"):
        journal = path.with_name(path.name + ending)
        if journal.is_file() and journal.stat().st_size:
            raise BagError(
                f"{path} was not closed: {journal.name} holds its last messages; copy both, call"
                f" `sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'`, and read the copy"
            )


def _checked_tables(path: Path) -> dict[int, str]:
    """Return the offered quality of service by topic's id.

    Refuses tables that compute their content, and topics of hostile number or size.

    Views, virtual tables and generated columns are programs that SQLite runs while it reads.

    Raises:
        BagError: naming the table.
        ConfigError: a quality of service that the guarded reader of YAML refuses.
    """
    address = f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_TEXT)
        ask = database.execute
        marks = ",".join("?" * len(TABLES))
        for kind, name, page in ask(
            f"SELECT type, name, rootpage FROM sqlite_master WHERE lower(name) IN ({marks})",  # noqa: S608 - question marks
            TABLES,
        ):
            computed = any(
                column[-1] for column in ask("SELECT * FROM pragma_table_xinfo(?)", (name,))
            )
            if kind != "table" or not page or computed:
                raise BagError(f"{path}: table {name} computes its content: {_AGAIN}")
        columns = {row[0] for row in ask("SELECT name FROM pragma_table_xinfo('topics')")}
        if "offered_qos_profiles" not in columns:  # before ROS 2 Foxy
            return {}
        topics = ask(
            "SELECT id, offered_qos_profiles FROM topics LIMIT ?", (MOST_TOPICS + 1,)
        ).fetchall()
    if len(topics) > MOST_TOPICS:
        raise BagError(f"{path}: more than {MOST_TOPICS} topics: {_AGAIN}")
    texts = {number: text for number, text in topics if isinstance(text, str) and text}
    for text in texts.values():
        parse_yaml(text)  # rosbags parses it without a guard
    return texts
