# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The documented parameters are those that the simulator has."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rover_sim_node.config import SimulatorConfig, leaves

PAGE = Path(__file__).parents[2] / "docs" / "simulator.md"


def row(name: str, value: Any, metadata: Mapping[str, Any]) -> str:
    """One line of the table, from the definition."""
    shown = str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
    low, high = metadata.get("low", -math.inf), metadata.get("high", math.inf)
    ends = f"{low:g} to {high:g}" if high < math.inf else f"{'above' if metadata.get('exclusive') else 'at least'} {low:g}"
    bounds = "" if math.isinf(low) else ends
    unit = metadata.get("unit", "")
    return f"| `{name}` | {f'`{shown}`' if shown else ''} | {'' if unit == '1' else unit} | {bounds} | {metadata['description']} |"


def test_the_table_of_parameters_is_that_of_the_definition() -> None:
    table = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    expected = [row(*leaf) for leaf in leaves(SimulatorConfig())]
    assert table == expected, "\n".join(["the table has to be:", *expected])
