# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The first sentence of a finding, and what it excludes."""

from typing import Any

from terrain_estimator.pages.opening import excluded, opening


def wheel_finding(verdict: str = "named") -> dict[str, Any]:
    pull = {"low": 4.1, "median": 5.3, "high": 6.4, "unit": "N"}
    sinkage = {"low": -0.001, "median": 0.0001, "high": 0.001, "unit": "m"}
    change = {"slip": 0.3, "load_n": 80.0, "rows": {"drawbar_pull": pull, "sinkage": sinkage}}
    effect = {"name": "grousers", "coefficient": 8.0, "sd": 1.0, "unit": "N", "change": change}
    error = {"before": 4.3, "after": 1.1, "unit": "N"}
    gap = {"after": 1.0, "described": True, "rows": {"drawbar_pull": error}}
    return {"verdict": verdict, "effects": [effect], "confusable_with": [], "gap": gap}


def test_a_wheel_s_first_sentence_says_what_how_much_and_what_adding_it_gains() -> None:
    assert opening(wheel_finding()) == (
        "Lugs: at slip 0.3 and 80 N the wheel pulls 5.3 N (4.1 to 6.4) more than a smooth one;"
        " adding it takes the error of the drawbar pull on unseen settings from 4.3 to 1.1 N."
    )
    assert not opening(wheel_finding("unknown"))


def drives_finding(torque_after: float) -> dict[str, Any]:
    effect = {"name": "drive_drag", "coefficient": 1.2, "sd": 0.06, "unit": "N m s/rad"}
    rows = [
        {"row": row, "region": "everywhere", "unit": unit, "error": [before, after]}
        for row, unit, before, after in (
            ("torque_2", "N m", 1.62, torque_after),
            ("velocity", "m/s", 0.00243, 0.00244),
        )
    ]
    gap = {"before": 39.7, "after": 1.1}
    found = {"verdict": "named", "effects": [effect], "confusable_with": [], "gap": gap}
    return found | {"proof": {"rows": rows}}


def test_the_first_sentence_names_what_is_lowered_where_the_velocity_is_not() -> None:
    end = "adding it takes the error of the torque of axle 2 on unseen runs from 1.6 to 0.034 N m."
    assert opening(drives_finding(0.034)).endswith(end)
    end = "adding it does not lower the error of the velocity on unseen runs (from 0.0024 to"
    assert end in opening(drives_finding(1.63))


def test_a_moment_over_the_weight_has_no_unit() -> None:
    finding = drives_finding(0.034)
    finding["proof"]["rows"][0] |= {"row": "bogie_moment", "unit": "1"}
    end = "adding it takes the error of the bogie moment on unseen runs from 1.6 to 0.034."
    assert opening(finding).endswith(end)


def test_candidates_far_behind_the_best_are_excluded_with_their_odds() -> None:
    lines = excluded({"grousers": 0.9, "exit_angle": 0.009, "none": 0.0, "bulldozing": 0.09})
    assert lines == [
        "exit_angle: 100 times less likely than grousers",
        "nothing missing: over 1e6 times less likely than grousers",
    ]


def test_a_name_that_the_held_out_runs_hardly_show_is_called_unproven() -> None:
    finding = drives_finding(0.034)
    finding["proof"] |= {"undecided": True}
    end = "; the held-out runs hardly show it, so that it is unproven."
    assert opening(finding).endswith(end)
