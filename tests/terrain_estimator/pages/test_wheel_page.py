# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The report about one wheel: its headline agrees with its table and its held-out errors."""

import re
from typing import Any

import pytest

from terrain_estimator.pages.wheel_finding import wheel_page

PROBABILITIES = {"none": 0.436, "unknown": 0.004, "slip_sinkage": 0.28, "rate_dependence": 0.28}


def finding(*, described: bool, none: float = 0.436) -> dict[str, Any]:
    row = {"before": 0.014, "after": None, "noise_floor": 0.001, "unit": "m"}
    return {
        "verdict": "none",
        "probabilities": PROBABILITIES | {"none": none},
        "effects": [],
        "confusable_with": [],
        "separate_by": "",
        "left": [],
        "gap": {
            "before": 14.0,
            "after": None,
            "proven": None,
            "described": described,
            "rows": {"sinkage": row},
        },
        "limits": [],
        "left_out": [],
        "asked": {"wheel": "w", "soil": "s", "reference": []},
        "runs": ["a.csv"],
        "held_out": ["each of 5 settings in turn"],
        "rows": ["sinkage"],
        "settings": 5,
        "measurements": 5,
        "given": [],
    }


@pytest.mark.parametrize(
    ("described", "none", "headline"),
    [
        (True, 0.9, "No missing effect found"),
        (True, 0.436, "No effect identified"),
        (False, 0.9, "No effect identified: the model does not describe these tables"),
    ],
)
def test_the_headline_agrees_with_the_table_and_with_the_held_out_errors(
    *, described: bool, none: float, headline: str
) -> None:
    page = wheel_page(finding(described=described, none=none))
    assert re.findall("<h1>(.*)</h1>", page) == [headline]
    assert ("14 deviations of repeatability, more than" in page) is not described
    assert ("Also possible: slip_sinkage" in page) is (none < 0.5)
