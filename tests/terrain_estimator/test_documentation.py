# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The documented parameters are those that the estimator has."""

from pathlib import Path

from terrain_estimator.config import EstimatorConfig
from terrain_estimator.parameters import Parameter, definitions

PAGE = Path(__file__).parents[2] / "docs" / "estimator.md"


def row(entry: Parameter) -> str:
    """One line of the table, from the definition."""
    default = str(entry.default).lower() if isinstance(entry.default, bool) else str(entry.default)
    return f"| `{entry.name}` | {f'`{default}`' if default else ''} | {entry.unit} | {entry.constraints} | {entry.description} |"


def test_the_table_of_parameters_is_that_of_the_definition() -> None:
    table = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    expected = [row(entry) for entry in definitions(EstimatorConfig)]
    assert table == expected, "\n".join(["the table has to be:", *expected])
