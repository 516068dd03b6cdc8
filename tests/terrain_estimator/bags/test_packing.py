# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bytes that are packed from fields are those of the messages.

Each comparison is of 400 drawn messages (60 in the short run), so that a fault in 2 % of them
escapes with a probability of 0.03 % (30 %).
"""

import os
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype

from terrain_estimator.bags import BagError, Definition, Packer, Types
from terrain_estimator.bags.format import packing
from terrain_estimator.messaging.messages import Meta
from terrain_estimator.messaging.pipeline import Answer
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import ADVICE, ESTIMATE, HEALTH, PREDICTION, TRUTH
from terrain_estimator.update import (
    Decision,
    Disagreement,
    Estimate,
    NamedEffect,
    Prediction,
    RowFit,
    Seconds,
    Update,
)

RUNS = 400 if "LONG_TESTS" in os.environ else 60
ODD = "x/msg/Odd"
TYPES = Types()
TYPES.add(
    Definition(
        ODD,
        "bool a\nstring[3] b\nfloat64 c\nPart[2] d\nchar e\nPart[] f\nint16[3] g\nbyte h\n"
        f"float32[] i\nint64 j\nuint8[] k\nstring[] l\nPart m\n{'=' * 80}\nMSG: x/Part\n"
        "string t\nuint16 u\nfloat64[] v\nint8 w\nint32 x\nfloat32 y",
        "",
    )
)
NAMES = (
    ESTIMATE, PREDICTION, HEALTH, ADVICE, TRUTH, ODD, "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState", "diagnostic_msgs/msg/DiagnosticArray",
)  # fmt: skip
PACKER = Packer(TYPES, ESTIMATE)
WHOLE = {"byte": (0, 7), "char": (0, 7)} | {
    f"{sign}int{bits}": (-(1 << bits - 1) if not sign else 0, bits - (not sign))
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
"""Least value, and bits above zero; rosbags takes a byte for signed when it writes one."""
TEXTS = st.text(st.characters(codec="utf-8"), max_size=9) | st.sampled_from(
    ["", "\0", "a\0b", "\U0001f916", "é" * 7, "status", "a" * 300]
)
FLOATS = st.floats()


def number(kind: str) -> st.SearchStrategy[Any]:
    if kind == "bool":
        return st.booleans()
    if kind.startswith("float"):
        return st.floats(width=32 if kind == "float32" else 64)
    least, bits = WHOLE[kind]
    return st.integers(least, (1 << bits) - 1)


def value(draw: st.DataObject, kind: Any) -> Any:
    """Draw what a field may be: a number, a text, the fields of a message, or a list of these."""
    if kind[0] == Nodetype.NAME:
        return fields(draw, kind[1])
    if kind[0] == Nodetype.BASE:
        single = kind[1][0]
        return draw.draw(TEXTS if single == "string" else number(single))
    element, length = kind[1]
    count = length if kind[0] == Nodetype.ARRAY else draw.draw(st.integers(0, 3))
    return [value(draw, element) for _ in range(count)]


def fields(draw: st.DataObject, type_name: str) -> tuple[str, dict[str, Any]]:
    return type_name, {name: value(draw, kind) for name, kind in TYPES.fields(type_name)}


def made(drawn: Any, make: Any) -> Any:
    """Return a drawn value with its messages made."""
    if isinstance(drawn, tuple):
        return make(drawn[0], **{name: made(each, make) for name, each in drawn[1].items()})
    return [made(each, make) for each in drawn] if isinstance(drawn, list) else drawn


@pytest.mark.parametrize("type_name", NAMES)
@settings(max_examples=RUNS // 4)
@given(st.data())
def test_drawn_fields_give_the_bytes_of_their_message(type_name: str, draw: st.DataObject) -> None:
    drawn = fields(draw, type_name)
    assert PACKER.pack(made(drawn, PACKER.make)) == TYPES.serialize(made(drawn, TYPES.make))


ROWS = st.lists(TEXTS, max_size=4).map(tuple)
COUNTS = st.integers(0, 1 << 40)
PAIRS = st.tuples(FLOATS, FLOATS)
ESTIMATES = st.builds(
    Estimate,
    mean=PAIRS.map(np.array),
    covariance=st.tuples(st.floats(0.0), FLOATS, FLOATS, st.floats(0.0)).map(
        lambda values: np.array(values).reshape(2, 2)
    ),
    lower_95=PAIRS.map(np.array),
    upper_95=PAIRS.map(np.array),
    identified=st.tuples(st.booleans(), st.booleans()),
    mass_below_zero=st.floats(0.0, 1.0) | st.just(np.nan),
    change_probability=FLOATS,
    soils=ROWS,
    soil_probability=st.lists(FLOATS, max_size=3).map(tuple),
    effects=st.lists(st.builds(NamedEffect, TEXTS, TEXTS, FLOATS, FLOATS), max_size=3).map(tuple),
    observations_used=COUNTS,
    observations_waiting=COUNTS,
    time_used_s=FLOATS,
    seconds=st.builds(Seconds, st.integers(0, 60), st.integers(0, 60)),
    fit=st.lists(st.builds(RowFit, TEXTS, FLOATS, FLOATS), max_size=3).map(tuple),
)
PREDICTIONS = st.builds(
    Prediction, st.booleans(), FLOATS, FLOATS, st.floats(0.0), FLOATS, FLOATS, FLOATS
)
DECISIONS = st.builds(
    Decision,
    st.sampled_from(Outcome),
    ROWS,
    FLOATS,
    FLOATS,
    st.integers(0, 60),
    TEXTS,
    st.integers(0, 60),
)
UPDATES = st.builds(
    Update,
    st.integers(0, (1 << 31) * 10**9 - 1),
    COUNTS,
    ESTIMATES,
    PREDICTIONS,
    DECISIONS,
    FLOATS,
    st.lists(st.builds(Disagreement, TEXTS, TEXTS), max_size=1).map(tuple),
    TEXTS,
    st.lists(TEXTS, max_size=1).map(tuple),
)


@settings(max_examples=RUNS)
@given(UPDATES, ROWS, st.builds(Meta, TEXTS, TEXTS, TEXTS, ROWS, TEXTS))
def test_any_estimate_gives_the_bytes_of_its_messages(
    update: Update, notes: tuple[str, ...], meta: Meta
) -> None:
    answer = Answer(update, notes)
    packed = {name: PACKER.pack(each) for name, each in answer.messages(PACKER.make, meta).items()}
    serialized = answer.messages(TYPES.make, meta).items()
    assert packed == {name: TYPES.serialize(message) for name, message in serialized}


def test_a_draft_needs_all_fields_and_no_other() -> None:
    with pytest.raises(BagError, match=r"has the fields sec, nanosec, and is given sec$"):
        PACKER.pack(PACKER.make("builtin_interfaces/msg/Time", sec=1))
    with pytest.raises(BagError, match="is given sec, min"):
        PACKER.pack(PACKER.make("builtin_interfaces/msg/Time", sec=1, min=2))
    with pytest.raises(BagError, match="is not installed"):
        Packer(TYPES, "no_package/msg/No")


def test_an_array_of_a_wrong_length_is_no_message() -> None:
    part = PACKER.make("x/msg/Part", t="", u=0, v=[], w=0, x=0, y=0.0)
    wrong = PACKER.make(
        ODD, a=True, b=["", "", ""], c=0.0, d=[part], e=0, f=[], g=[0, 0, 0], h=0, i=[], j=0, k=[],
        l=[], m=part,
    )  # fmt: skip
    with pytest.raises(BagError, match="d has 1 of 2 values"):
        PACKER.pack(wrong)


def test_formats_that_are_too_many_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing, "_MOST", 3)
    packer = Packer(TYPES)
    for length in (*range(9), 0):
        stamp = packer.make("builtin_interfaces/msg/Time", sec=1, nanosec=2)
        draft = packer.make("std_msgs/msg/Header", stamp=stamp, frame_id="a" * length)
        assert packer.pack(draft)[12:] == bytes([length + 1, 0, 0, 0]) + b"a" * length + b"\0"
