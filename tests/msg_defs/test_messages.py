# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The message definitions and their documentation agree."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MESSAGES = sorted((ROOT / "msg_defs/msg").glob("*.msg"))
# A field with a number in it: its comment has to begin with a unit (or, of effects, to name the
# field that holds it).
NUMBER = re.compile(r"^(?:float64|u?int\d+)(?:\[\d*\])?\s+(?P<name>\w+)\s*(?P<comment>#.*)?$")
UNIT = re.compile(r"^# \[[^\]]+\] \S|^# \[[^\]]+\]$")
CONSTANT_OF = {"level", "outcome", "status"}  # enumerations, not quantities


def fields(path: Path) -> list[tuple[str, str]]:
    lines = (NUMBER.match(line) for line in path.read_text(encoding="utf-8").splitlines())
    return [(line["name"], line["comment"] or "") for line in lines if line]


@pytest.mark.parametrize("path", MESSAGES, ids=lambda path: path.stem)
def test_every_number_has_its_unit_in_the_comment(path: Path) -> None:
    missing = [
        name
        for name, comment in fields(path)
        if name not in CONSTANT_OF and not UNIT.match(comment)
    ]
    assert missing == []


def test_the_check_of_units_sees_fields_and_constants() -> None:
    assert {name for name, _ in fields(ROOT / "msg_defs/msg/WheelSlip.msg")} == {
        "sequence",
        "slip",
        "slip_stddev",
        "lateral_slip",
        "slip_angle",
    }


def test_every_message_is_built() -> None:
    listed = re.findall(
        r'"msg/(\w+)\.msg"', (ROOT / "msg_defs/CMakeLists.txt").read_text(encoding="utf-8")
    )
    assert listed == [path.stem for path in MESSAGES]


@pytest.mark.parametrize("path", MESSAGES, ids=lambda path: path.stem)
def test_every_message_has_a_class_with_its_fields(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    written = re.findall(r"^[\w/]+(?:\[\d*\])? ([a-z]\w*) ", text, re.MULTILINE)
    message = getattr(importlib.import_module("msg_defs.msg"), path.stem)
    assert list(message.get_fields_and_field_types()) == written


def test_the_order_of_the_covariance_is_written_down() -> None:
    text = (ROOT / "msg_defs/msg/TerrainEstimate.msg").read_text(encoding="utf-8")
    assert re.search(r"float64\[4\] covariance .*row-major: c c, c t, t c, t t", text)


def test_every_published_message_has_its_topic_in_the_quality_of_service_table() -> None:
    table = re.findall(
        r"^\| `([\w/]+)` \| `msg_defs/msg/(\w+)` \|",
        (ROOT / "docs/messages.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    parts_of_others = {"MeasurementDecision"}
    assert {name for _, name in table} == {path.stem for path in MESSAGES} - parts_of_others
    for topic, name in table:
        text = (ROOT / f"msg_defs/msg/{name}.msg").read_text(encoding="utf-8")
        assert f"Topic {topic}" in text
