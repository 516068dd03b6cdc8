# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Identity of topics by value."""

import math
import re
from pathlib import Path
from typing import Any

import pytest

from terrain_estimator.bags import BagError, BagWriter, compare

TYPE = "msg_defs/msg/TerrainEstimate"
TOPIC = "/terrain_estimate"


def estimates(
    folder: Path,
    cohesions: list[float],
    *,
    offset_ns: int = 0,
    padding: bytes = b"\0\0\0\0",
    **fields: Any,
) -> Path:
    with BagWriter(folder) as writer:
        topic = writer.add_topic(TOPIC, TYPE)
        for number, cohesion in enumerate(cohesions):
            message = writer.types.make(
                TYPE, sequence=number, cohesion=cohesion, rows=["velocity"], **fields
            )
            # The two bytes after the kind of encoding, and what alignment leaves free, carry no
            # value.
            data = writer.types.serialize(message)
            writer.write(topic, data[:2] + padding[:2] + data[4:], number + offset_ns)
    return folder


def test_equal_values_are_equal_whatever_the_padding_and_the_log_times(tmp_path: Path) -> None:
    first = estimates(tmp_path / "a", [1.0, math.nan])
    second = estimates(tmp_path / "b", [1.0, math.nan], offset_ns=77, padding=b"\xab\xcd")
    assert compare(first, TOPIC, second, TOPIC) is None


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"covariance": [0.0, 0.0, 1e-300, 0.0]}, r"message 0, covariance\[2\]: "),
        ({"status_text": "x"}, "message 0, status_text: '' in the first bag, 'x' in the second"),
        (
            {"effect": ["grade"]},
            r"message 0, effect: \[\] in the first bag, \['grade'\] in the second",
        ),
        ({"tan_phi": -0.0}, "message 0, tan_phi: 0.0 in the first bag, -0.0 in the second"),
    ],
)
def test_the_first_field_that_differs_is_named(
    tmp_path: Path, fields: dict[str, Any], words: str
) -> None:
    first, second = (
        estimates(tmp_path / "a", [1.0, 2.0]),
        estimates(tmp_path / "b", [1.0, 2.0], **fields),
    )
    difference = compare(first, TOPIC, second, TOPIC)
    assert difference is not None

    assert re.search(words, str(difference))


def test_the_first_message_that_differs_is_named(tmp_path: Path) -> None:
    first, second = (
        estimates(tmp_path / "a", [1.0, 2.0, 3.0]),
        estimates(tmp_path / "b", [1.0, 2.0, 3.0000000000000004]),
    )
    difference = compare(first, TOPIC, second, TOPIC)
    assert difference is not None
    assert (difference.index, difference.field, difference.second) == (
        2,
        "cohesion",
        "3.0000000000000004",
    )


def test_a_message_more_is_a_difference(tmp_path: Path) -> None:
    first, second = estimates(tmp_path / "a", [1.0, 2.0]), estimates(tmp_path / "b", [1.0])
    assert (
        str(compare(first, TOPIC, second, TOPIC))
        == "message 1: present in the first bag, missing in the second"
    )


def test_a_topic_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    folder = estimates(tmp_path / "a", [1.0])
    with pytest.raises(BagError, match="has no topic /estimate: it has /terrain_estimate"):
        compare(folder, TOPIC, folder, "/estimate")
