# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Message definitions of bags: refused before code is made of them, where they ask for too much."""

import time
import tracemalloc
from pathlib import Path

import pytest
from mcap.records import Channel, Header, McapRecord, Message, Schema

from terrain_estimator.bags import BagError, Definition, Types, installed_definition
from terrain_estimator.bags.format.definitions import parse, type_hash
from terrain_estimator.bags.reading.records import MAGIC
from terrain_estimator.cli import replay
from tests.terrain_estimator.bags.support import SLIP, TYPES
from tests.terrain_estimator.bags.test_bombs import built

SEPARATOR = "=" * 80
MOST_OBJECTS = 20_000
REMEDY = "record the bag again"


def nested(levels: int, field: str) -> str:
    """Return a definition of types within each other; ``field`` uses the next one, X{n}."""
    parts = [field.format(n=0)]
    parts += [f"MSG: x/X{n}\n{field.format(n=n + 1)}" for n in range(levels)]
    parts += [f"MSG: x/X{levels}\nuint8 x"]
    return f"\n{SEPARATOR}\n".join(parts)


HOSTILE = {
    "array of texts": ("string[300000000] x", r"field x: array of size 300000000, not 1 to"),
    "array of messages": (
        f"Y[900000] y\n{SEPARATOR}\nMSG: x/Y\nuint8 x",
        r"type x/msg/X, field y: more than 20000 fields",
    ),
    "fields": (
        "".join(f"uint8 x{n}\n" for n in range(100_000)),
        r"has \d+ bytes, more than 262144",
    ),
    "short fields": ("".join(f"u x{n}\n" for n in range(20_000)), r"more than 5000 fields"),
    "arrays without size": (nested(9, "X{n}[0] y"), r"array of size 0, not 1 to"),
    "arrays in arrays": (nested(9, "X{n}[100] y"), r"more than 20000 fields"),
    "types twice": (nested(30, "X{n} a\nX{n} b"), r"more than 20000 fields"),
    "lists twice": (nested(30, "X{n}[] a\nX{n}[] b"), r"more than 20000 fields"),
    "deep": (nested(100, "X{n} y"), r"more than 40 types within each other"),
    "very deep": (nested(1500, "X{n} y"), r"more than 5000 fields or 500 types"),
    "large constant": ("float64 A=1e999", r"line 1, field A: value '1e999' is too large"),
    "large default": ("float64 a -1e999", r"field a: value '-1e999' is too large"),
    "long size": ("uint8[" + "9" * 1900 + "] x", r"a number of 1900 digits"),
    "longer size": ("uint8[" + "9" * 5000 + "] x", r"line 1 has 5009 characters"),
    "long constant": ("int64 A=" + "9" * 1900, r"a number of 1900 digits"),
    "negative size": ("uint8[-1] x", r"is no field or constant"),
    "no definition": ("\x00", r"is no field or constant"),
    "quote": ("string A='" + "x\n" * 1000, r"line 2, 'x', is no field or constant"),
    "text": ("1 2\n", r"line 1, '1 2', is no field or constant"),
    "itself": ("X x", r"contains itself"),
    "twice": ("uint8 x\nuint16 x", r"x/msg/X"),
    "annotation": ("@key uint8 x", r"is no field or constant"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_definition_is_refused_by_type_field_and_value(name: str) -> None:
    text, words = HOSTILE[name]
    started = time.process_time()
    tracemalloc.start()
    try:
        with pytest.raises(BagError, match=words) as caught:
            Types().add(Definition("x/msg/X", text, ""))
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()
    assert time.process_time() - started < 5.0
    assert len(str(caught.value)) < 400
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "name", ["1/2", "", "x", "x/msg/X\nuint8 y", "x/msg/" + "X" * 9000, "a/b/c"]
)
def test_a_type_needs_a_name_of_ros(name: str) -> None:
    with pytest.raises(BagError, match="is not the name of a message type"):
        parse(name, "uint8 x")


def test_definitions_of_ros_are_within_the_limits() -> None:
    for name in ("nav_msgs/msg/Odometry", "diagnostic_msgs/msg/DiagnosticArray", *TYPES.values()):
        installed = installed_definition(name)
        assert type_hash(name, installed.text).startswith("RIHS01_")
    text = (
        "# a comment with 'quotes' and \"others\"\n"
        "string<=10[<=3] names  # a comment\n"
        "float64[36] covariance\n"
        "int32 LOWEST=-0x10\n"
        "string GREETING='it # is'\n"
        "string OPEN=don't  \n"
        "float32 x 1.5\n"
        "float64 NAN=nan\n"
        "uint8[] data [1, 2]\n"
        "\tbool flag true\r\n"
    )
    Types().add(Definition("x/msg/X", text.replace("\r", ""), ""))


def hostile_bag(path: Path, text: str) -> Path:
    """Write a bag whose topic of slip has this definition."""
    records: list[McapRecord] = [Header(profile="ros2", library="")]
    for number, (topic, kind) in enumerate(TYPES.items(), start=1):
        definition = text if topic == SLIP else installed_definition(kind).text
        records += [
            Schema(id=number, data=definition.encode(), encoding="ros2msg", name=kind),
            Channel(id=number, topic=topic, message_encoding="cdr", metadata={}, schema_id=number),
            Message(
                channel_id=number,
                log_time=number,
                data=b"\0\1\0\0" + bytes(16),
                publish_time=number,
                sequence=0,
            ),
        ]
    path.write_bytes(MAGIC + built(*records))
    return path


def test_a_replay_of_hostile_definitions_ends_with_one_line_and_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for number, name in enumerate(("array of texts", "arrays without size", "large constant")):
        path = hostile_bag(tmp_path / f"bag_{number}.mcap", HOSTILE[name][0])
        assert replay.main([str(path)]) == 2
        last = capsys.readouterr().err.splitlines()[-1]
        assert all(words in last for words in (path.name, TYPES[SLIP], "field", REMEDY)), last


@pytest.mark.parametrize(
    "element",
    [
        "uint8[1] a",
        "string a",
        f"Z z\n{SEPARATOR}\nMSG: x/Z\nW[1] w\n{SEPARATOR}\nMSG: x/W\nuint8 w",
    ],
)
def test_an_object_of_a_message_takes_less_than_200_bytes(
    element: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("terrain_estimator.bags.format.types.MOST_OBJECTS", MOST_OBJECTS)
    types = Types()
    types.add(Definition("x/msg/X", f"Y[] y\n{SEPARATOR}\nMSG: x/Y\n{element}", ""))
    least = 8 if "string" in element else 1
    tracemalloc.start()
    try:
        for count in (MOST_OBJECTS * 2, MOST_OBJECTS // 9):
            one = b"\1\0\0\0\0\0\0\0" if least == 8 else b"\1"
            data = b"\0\1\0\0" + count.to_bytes(4, "little") + one * count
            if count > MOST_OBJECTS:
                with pytest.raises(BagError, match="more than 20000 objects"):
                    types.deserialize(data, "x/msg/X")
            else:
                assert len(types.deserialize(data, "x/msg/X").y) == count
        assert tracemalloc.get_traced_memory()[1] < 200 * MOST_OBJECTS
    finally:
        tracemalloc.stop()


def test_a_large_list_of_numbers_is_decoded() -> None:
    types = Types()
    types.add(Definition("x/msg/X", "float64[] x\nuint8[] y", ""))
    data = b"\0\1\0\0" + (1_000_000).to_bytes(8, "little") + bytes(8_000_004)
    assert len(types.deserialize(data, "x/msg/X").x) == 1_000_000
