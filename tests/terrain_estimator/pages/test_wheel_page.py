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
        "fits": {
            "effects": [],
            "constants_free": {
                "rows": {"sinkage": {"rms": 0.002, "unit": "m"}},
                "unknowns": 7,
                "measurements": 5,
            },
            "constants_as_measured": None,
            "why": "c and tan phi are not identified",
            "shear_box": None,
        },
        "limits": [],
        "left_out": [],
        "asked": {"wheel": "w", "soil": "s", "reference": [], "reference_lacks": []},
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
    assert ("14 deviations of measurement, more than" in page) is not described
    assert ("Also possible: slip_sinkage" in page) is (none < 0.5)


@pytest.mark.parametrize(
    ("proven", "headline"),
    [
        (None, "The model does not describe these tables; it may lack slip_sinkage"),
        (
            True,
            "The model lacks slip_sinkage; even with that the model does not describe these tables",
        ),
    ],
)
def test_an_effect_that_leaves_large_errors_is_not_called_the_answer(
    *, proven: bool | None, headline: str
) -> None:
    given = finding(described=False, none=0.1)
    effect = {"name": "slip_sinkage", "coefficient": 0.8, "sd": 0.4, "unit": "1"}
    given["effects"] = [effect | {"probability": 0.9, "log_bayes_factor": 9.0}]
    given |= {"verdict": "named", "probabilities": {"none": 0.1, "slip_sinkage": 0.9}}
    given["gap"] |= {"after": 13.0, "proven": proven}
    given["gap"]["rows"]["sinkage"]["after"] = 0.013
    page = wheel_page(given)
    assert re.findall("<h1>(.*)</h1>", page) == [headline]
    assert "13 deviations of measurement, more than" in page
