# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of rosbag2's other storage and of its compression modes, written by the rosbags library."""

import re
import shutil
import sqlite3
from contextlib import closing
from functools import cache
from pathlib import Path

import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from terrain_estimator.bags import BagError, BagReader, RawMessage, recover
from terrain_estimator.bags.reading import sqlite_file, storage

SAMPLE = Path(__file__).parents[3] / "bags/sample"
SECONDS = 6
SQLITE, MCAP = StoragePlugin.SQLITE3, StoragePlugin.MCAP
FORMS = {
    "sqlite3": (SQLITE, CompressionMode.NONE),
    "sqlite3_file": (SQLITE, CompressionMode.FILE),
    "sqlite3_message": (SQLITE, CompressionMode.MESSAGE),
    "mcap_file": (MCAP, CompressionMode.FILE),
    "mcap_message": (MCAP, CompressionMode.MESSAGE),
}
every_form = pytest.mark.parametrize("form", FORMS)


@cache
def first_messages() -> tuple[list[RawMessage], dict[str, str]]:
    """Return the first seconds of the sample, and its definitions by type."""
    with BagReader(SAMPLE) as reader:
        end_ns = reader.span.first_ns + SECONDS * 10**9
        raws = [raw for raw in reader.messages() if raw.log_time_ns < end_ns]
        texts = {
            topic.type_name: topic.definition.text
            for topic in reader.topics.values()
            if topic.definition
        }
    return raws, texts


def write(folder: Path, form: str) -> Path:
    """Write the first seconds of the sample in another form."""
    plugin, mode = FORMS[form]
    raws, texts = first_messages()
    types = Typestore()
    for name, text in texts.items():
        types.register(get_types_from_msg(text, name))
    writer = Writer(folder / form, version=9, storage_plugin=plugin)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            (raw.topic, raw.type_name): writer.add_connection(
                raw.topic, raw.type_name, typestore=types
            )
            for raw in {raw.topic: raw for raw in raws}.values()
        }
        for raw in raws:
            writer.write(connections[raw.topic, raw.type_name], raw.log_time_ns, raw.data)
    return folder / form


def contents(path: Path) -> list[tuple[int, str, str, bytes]]:
    with BagReader(path) as reader:
        assert all(reader.decode(raw) is not None for raw in reader.messages())
        return sorted(
            (raw.log_time_ns, raw.topic, raw.type_name, raw.data) for raw in reader.messages()
        )


@every_form
def test_every_form_holds_the_same_messages(form: str, tmp_path: Path) -> None:
    folder = write(tmp_path, form)
    wanted = sorted((r.log_time_ns, r.topic, r.type_name, r.data) for r in first_messages()[0])
    assert len(wanted) > 400
    assert contents(folder) == wanted
    with BagReader(folder) as reader:
        assert (reader.span.count, reader.span.first_ns) == (len(wanted), wanted[0][0])
        assert (reader.finished, reader.notes) == (True, [])
    (folder / "metadata.yaml").unlink()
    assert contents(folder) == wanted
    [file] = folder.iterdir()
    assert contents(file) == wanted


def test_a_file_of_before_jazzy_is_read_with_the_installed_definitions(tmp_path: Path) -> None:
    [file] = write(tmp_path, "sqlite3").glob("*.db3")
    wanted = contents(file)
    change(file, "DELETE FROM message_definitions")
    assert contents(file) == wanted
    with BagReader(file) as reader:
        assert re.search(" has no definition of .*msg_defs/msg/EstimatorHealth, ", reader.notes[0])


def change(file: Path, statements: str) -> None:
    with closing(sqlite3.connect(file)) as database:
        database.executescript(statements)


ALIASES = "[&a [x], *a]"
HOSTILE = {
    "quality of service: .*alias": f"UPDATE topics SET offered_qos_profiles = '{ALIASES}'",
    "table messages computes its content": (
        "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER,"
        " timestamp INTEGER, data BLOB AS (zeroblob(900000000)));"
    ),
    "table topics computes its content": (
        "ALTER TABLE topics RENAME TO t; CREATE VIEW topics AS SELECT * FROM t;"
    ),
    "a str as its data": "UPDATE messages SET data = 'text'",
    "is damaged .*no such column": "ALTER TABLE topics DROP COLUMN type_description_hash",
    "missing tables": "DROP TABLE messages",
    "is damaged .*too big": "UPDATE messages SET data = zeroblob(3000000) WHERE id = 3",
    "more than 10000 topics": (
        "INSERT INTO topics WITH RECURSIVE n(i) AS (SELECT 100 UNION ALL SELECT i + 1 FROM n"
        " WHERE i < 10101) SELECT i, i, 'a', 'cdr', '', '' FROM n"
    ),
}


@pytest.mark.parametrize(("words", "statements"), HOSTILE.items())
def test_a_hostile_database_is_refused_in_one_line(
    words: str, statements: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sqlite_file, "LARGEST_CONTENTS", 2_000_000)
    [file] = write(tmp_path, "sqlite3").glob("*.db3")
    change(file, statements)
    with pytest.raises(BagError, match=words) as caught:
        contents(file)
    assert "\n" not in str(caught.value)
    assert str(file) in str(caught.value)


def test_a_database_with_a_journal_is_not_read_in_part(tmp_path: Path) -> None:
    [file] = write(tmp_path, "sqlite3").glob("*.db3")
    file.with_name(file.name + "-wal").write_bytes(b"x")
    with pytest.raises(BagError, match="was not closed"):
        contents(file)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.99])
def test_a_cut_file_is_refused(share: float, tmp_path: Path) -> None:
    for form in ("sqlite3", "sqlite3_file"):
        [file] = (each for each in write(tmp_path, form).iterdir() if each.suffix != ".yaml")
        data = file.read_bytes()
        file.write_bytes(data[: int(share * len(data))])
        with pytest.raises(BagError, match=file.name):
            contents(file)


def test_bytes_that_unpack_to_gigabytes_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bomb = tmp_path / "bomb.mcap.zstd"
    bomb.write_bytes(zstandard.compress(bytes(80 << 20)))
    with pytest.raises(BagError, match="unpack to more than 67108864"):
        BagReader(bomb)
    monkeypatch.setattr(storage, "LARGEST_CONTENTS", 1 << 20)
    message = zstandard.compress(bytes(3 << 20))
    with pytest.raises(BagError, match=r"a message of .* unpacks to"):
        storage.plain(message, bomb)
    twice = tmp_path / "twice.mcap.zstd"
    twice.write_bytes(zstandard.compress(message))
    with pytest.raises(BagError, match="compressed twice"):
        BagReader(twice)


def test_recover_bag_names_the_tool_for_a_database(tmp_path: Path) -> None:
    folder = write(tmp_path, "sqlite3")
    [file] = folder.glob("*.db3")
    for source in (folder, file):
        with pytest.raises(BagError, match=r"sqlite3 .*\.recover"):
            recover(source, tmp_path / "mended")
    shutil.rmtree(folder)
