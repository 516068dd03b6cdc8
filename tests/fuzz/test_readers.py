# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Readers give the content of a file or their documented error; `make fuzz` searches further."""

import contextlib
import dataclasses
import functools
import math
import re
import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError, build
from rover_parameters.yaml_files import parse_yaml
from terrain_estimator.config.estimator import EstimatorNodeConfig
from terrain_estimator.importing.mapping import Mapping
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from tests.fuzz.mutations import mutations
from tests.fuzz.targets import TARGETS

ROOT = Path(__file__).parents[2]
WORDS = (
    b"!!timestamp ",
    b"!!bool x",
    b"1e400",
    b"2001-13-45",
    b"0x",
    b"&a ",
    b"*a",
    b"nan",
    b"-.inf",
    b"9" * 400,
    b"[" * 2000,
    b"\0",
    b"\xff",
    b'"',
)
"""Words that are difficult for readers of text."""


@st.composite
def damaged(draw: st.DrawFn, name: str) -> bytes:
    """Draw a sound file with some bytes removed, doubled, or replaced by others or by words."""
    data = bytearray(draw(st.sampled_from(_seeds(name))))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 12)))
        replacement = draw(
            st.binary(max_size=8) | st.sampled_from(WORDS) | st.just(bytes(data[start:end]) * 2)
        )
        data[start:end] = replacement
    return bytes(data)


@functools.cache
def _seeds(name: str) -> list[bytes]:
    return TARGETS[name].seeds()


def examples(share: float) -> Any:
    """Return settings with this share of the profile's examples."""
    return settings(max_examples=max(1, int(share * settings().max_examples)))


@pytest.mark.parametrize("name", TARGETS)
def test_a_damaged_file_is_read_or_refused_with_the_documented_error(name: str) -> None:
    """Run a target, which raises an error for a finding."""

    @examples(0.3)
    @given(data=damaged(name))
    def attempt(data: bytes) -> None:
        TARGETS[name](data)

    attempt()


@examples(0.3)
@given(data=st.binary(max_size=200))
@example(b"\x89MCAP0\r\n" + bytes(100))
def test_bytes_of_no_form_are_refused_by_every_reader(data: bytes) -> None:
    for target in TARGETS.values():
        target(data)


def test_random_damage_is_counted_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: Path) -> None:
        raise KeyError("lost")

    assert mutations("bag", 20, 1, tmp_path).findings == 0
    assert "bag: 20 damaged files, 0 findings, 95 % limit 0.1" in capsys.readouterr().out
    monkeypatch.setitem(TARGETS, "soil", dataclasses.replace(TARGETS["soil"], read=fail))
    assert mutations("soil", 2, 1, tmp_path).findings == 2
    assert "soil: KeyError: 'lost'" in capsys.readouterr().out
    assert len(list(tmp_path.iterdir())) == 2


SCALARS = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.just(10**400)
    | st.binary(max_size=3)
)
BRANCHES = st.text(max_size=5) | st.integers()
TREES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(BRANCHES, inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.parametrize("name", ["soil", "rover", "mapping"])
def test_wrong_values_under_right_keys_are_refused_by_name_or_in_range(name: str) -> None:
    record: type[Any] = {"soil": Soil, "rover": Rover, "mapping": Mapping}[name]
    sound = yaml.safe_load(_seeds(name)[0])

    @examples(0.3)
    @given(key=st.sampled_from(sorted(sound)), value=TREES)
    def attempt(key: str, value: object) -> None:
        try:
            built = build(record, {**sound, key: value}, "here")
        except ConfigError as error:
            said = str(error)
        else:
            said = "here: "
            assert not isinstance(getattr(built, key), float) or math.isfinite(getattr(built, key))
        assert said.startswith("here: ")

    attempt()


@examples(0.3)
@given(
    values=st.dictionaries(
        st.sampled_from(["model", "forgetting_time", "use_imu", "prior", "pairing_timeout", "x"]),
        TREES,
        max_size=3,
    )
)
def test_parameters_of_any_form_are_taken_or_refused_by_name(values: dict[str, object]) -> None:
    said = "parameter"
    try:
        configure(EstimatorNodeConfig, values)
    except ConfigError as error:
        said = str(error)
    assert "parameter" in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 500, "more than 32 lists and mappings within each other"),
        ("- " * 500, "more than 32 lists and mappings within each other"),
        ("a: !!bool x", "tag 'tag:yaml.org,2002:bool'"),
        ("a: &x {b: *x}", "an anchor"),
        ("a: *x", "alias"),
        ("[" + "1," * 300_000 + "]", "more than 200000 values"),
        ("a" * (5 << 20), "more than 4194304"),
        ("? [a]\n: 1", "a key is a list or mapping"),
        ("{a: 1, 'a': 2}", "key 'a' is given twice"),
        ("---\na\n---\nb", "a second document begins"),
        ("a: \x07", "special characters|control characters"),
        ("a: \ud800", "surrogates"),
    ],
)
def test_yaml_that_ended_in_a_traceback_or_without_end_is_refused(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        parse_yaml(text)


@pytest.mark.parametrize(
    "text",
    [
        "a: " + "1" * 1_000_000 + "e",
        "a: " + "1" * 200_000 + ":" + "1:" * 200_000,
        "{" + "".join(f"k{n}: 1, " for n in range(90_000)) + "}",
        "{" + "".join(f"{n * (2**61 - 1)}: 1, " for n in range(90_000)) + "}",
        "[" * 1_000_000,
        "a: " + "'" * 1_000_000,
        "a: |\n" + " x\n" * 500_000,
        "#\n" * 2_000_000,
        "? " * 500_000,
        "a: [" + "b: " * 500_000,
        '"' + "\\x41" * 500_000 + '"',
    ],
    ids=lambda text: text[:12].encode("unicode_escape").decode(),
)
def test_yaml_is_read_or_refused_in_linear_time(text: str) -> None:
    started = time.process_time()
    with contextlib.suppress(ConfigError):
        parse_yaml(text)
    assert time.process_time() - started < 3.0


def test_plain_words_are_read_as_ros_reads_them() -> None:
    text = "[1, -2, 1e6, .5, 2., -.inf, true, off, ~, 2001-13-45, 1:30, 017, 0x1F, 1_0, '7', =, <<]"
    values = [1, -2, 1e6, 0.5, 2.0, -math.inf, True, False, None]
    assert parse_yaml(text) == [
        *values,
        *("2001-13-45", "1:30", "017", "0x1F", "1_0", "7", "=", "<<"),
    ]
    assert parse_yaml("{1: a, on: b}") == {"1": "a", "on": "b"}
    assert parse_yaml("") is None


def test_plain_yaml_is_read_in_one_module_alone() -> None:
    """Also the parsers of PyYAML: every other use writes YAML."""
    reading = re.compile(r"yaml\.\w*(?:load|parse|scan|compose|Loader|Reader)\w*")
    packages = (
        "rover_parameters",
        "terramechanics",
        "terrain_estimator",
        "rover_sim_node",
        "studies",
    )
    found = {
        path.name
        for package in packages
        for path in (ROOT / package).rglob("*.py")
        if reading.search(path.read_text(encoding="utf-8"))
    }
    assert found == {"yaml_files.py"}
