# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Content of finding.json."""

import json

from terrain_estimator.offline.finding_file import known


def test_a_number_that_is_not_finite_is_null_and_costs_nothing_else() -> None:
    content = {
        "gap": {"before": 4.5, "after": float("nan"), "closed_95": (float("-inf"), 1.0)},
        "effects": [{"sd": 2}],
        "added": True,
    }
    assert json.loads(json.dumps(known(content), allow_nan=False)) == {
        "gap": {"before": 4.5, "after": None, "closed_95": [None, 1.0]},
        "effects": [{"sd": 2}],
        "added": True,
    }
