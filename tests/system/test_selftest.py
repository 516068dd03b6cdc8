# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The selftest as a user starts it, and that it can fail."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from terrain_estimator.cli.selftest import report
from terrain_estimator.demonstration.output_checks import OUTPUTS, verdicts
from tests.system.processes import Starter

GOOD: dict[str, SimpleNamespace] = {
    "terrain_estimate": SimpleNamespace(
        cohesion=1000.0, cohesion_stddev=100.0, tan_phi=0.6, tan_phi_stddev=0.03
    ),
    "ground_truth/terrain": SimpleNamespace(cohesion=1100.0, tan_phi=0.55),
    "motion_prediction": SimpleNamespace(innovation=0.01, innovation_variance=1e-4),
    "estimator_health": SimpleNamespace(accepted=5, rejected=0, summary=""),
    "traction_advice": SimpleNamespace(
        stop=False,
        speed_limit=0.2,
        measured_slip=0.1,
        measured_sinkage=0.02,
        front_stall_probability=0.0,
        status_text="go on",
    ),
    "terrain_map": SimpleNamespace(width=3),
}


def drive(**changes: Any) -> dict[str, list[Any]]:
    """Messages of a sound drive of five steps, with fields of one topic changed."""
    messages = {topic: [GOOD.get(topic, SimpleNamespace())] * 5 for topic in OUTPUTS}
    for topic, fields in changes.items():
        messages[topic] = [SimpleNamespace(**(vars(GOOD[topic]) | fields))] * 5
    return messages


def test_it_passes_on_the_real_nodes(start: Starter, domain_id: int) -> None:
    process = start(
        "terrain_estimator", "selftest", "--domain-id", str(domain_id), "--duration", "8"
    )
    assert process.wait(180.0) == 0, process.output
    assert [
        line.split()[1] for line in process.output.splitlines() if line.startswith("PASS")
    ] == list(OUTPUTS)


def test_a_sound_drive_passes() -> None:
    found = verdicts(drive(), 5)
    assert [verdict.fault for verdict in found] == [""] * len(OUTPUTS)
    assert report(found) == 0


@pytest.mark.parametrize("topic", OUTPUTS)
def test_an_output_that_is_silent_fails(topic: str) -> None:
    failed = [verdict.output for verdict in verdicts(drive() | {topic: []}, 5) if verdict.fault]
    assert topic in failed


@pytest.mark.parametrize(
    ("topic", "fields"),
    [
        ("terrain_estimate", {"cohesion": 2000.0}),
        ("terrain_estimate", {"tan_phi": math.nan}),
        ("motion_prediction", {"innovation": 0.1}),
        ("motion_prediction", {"innovation": math.nan}),
        ("estimator_health", {"rejected": 1}),
        ("estimator_health", {"accepted": 0}),
        ("traction_advice", {"stop": True}),
        ("traction_advice", {"speed_limit": math.nan}),
        ("terrain_map", {"width": 0}),
    ],
)
def test_an_output_that_is_wrong_fails_and_says_why(
    topic: str, fields: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert report(verdicts(drive(**{topic: fields}), 5)) == 1
    assert f"FAIL  {topic}: " in capsys.readouterr().out


def test_a_lost_message_fails() -> None:
    assert [verdict.output for verdict in verdicts(drive(), 6) if verdict.fault] == [
        topic
        for topic in OUTPUTS
        if topic
        not in {
            "ground_truth/terrain",
            "estimator_health",
            "traction_advice",
            "terrain_map",
        }
    ]
