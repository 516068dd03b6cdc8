# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The catalogue of effects in the documentation is the registry's."""

from pathlib import Path

import pytest

from rover_parameters.records import ConfigError
from terramechanics.effects import EFFECTS, Description, describe

PAGE = Path(__file__).parents[3] / "docs" / "effects.md"


def row(effect: Description) -> str:
    """Return one line of the table, from the registry."""
    unit = "" if effect.unit == "1" else effect.unit
    limits = f"{effect.low:g} to {effect.high:g}"
    rows = ", ".join(effect.rows)
    return (
        f"| `{effect.name}` | {effect.sentence} | `{effect.coefficient}` | {unit} | {limits} |"
        f" {rows} | {effect.source} |"
    )


def test_the_table_is_that_of_the_registry() -> None:
    table = [
        line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")
    ]
    expected = [row(effect) for effect in EFFECTS.values()]
    assert table == expected, "\n".join(["the table has to be:", *expected])


def test_the_table_of_competing_laws_is_that_of_the_registry() -> None:
    head = "| effect | competing law | size | source |"
    text = PAGE.read_text(encoding="utf-8")
    lines = text[text.index(head) :].split("\n\n")[0].splitlines()
    expected = []
    for name, effect in EFFECTS.items():
        for law in effect.competing:
            unit = "" if law.unit == "1" else f" {law.unit}"
            size = f"0 to {law.high:g}{unit}"
            expected.append(f"| {name} | {law.name} | {size} | {law.source} |")
    assert lines[2:] == expected, "\n".join(["the table has to be:", *expected])


def test_every_effect_has_one_sentence_a_unit_a_source_and_a_range_around_nothing() -> None:
    for name, effect in EFFECTS.items():
        assert effect.name == name
        assert effect.sentence.endswith(".")
        assert effect.sentence.count(". ") == 0
        assert effect.source
        assert effect.rows
        assert effect.low <= 0.0 < effect.high


def test_an_unknown_name_is_refused_with_the_list() -> None:
    with pytest.raises(
        ConfigError,
        match=(
            r"unknown effect 'mud'; known effects are slope_bias, bulldozing, .*lateral_bulldozing"
        ),
    ):
        describe("mud")
