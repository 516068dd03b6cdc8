# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The sample recording replays with the present messages and model."""

import json
from pathlib import Path

import pytest

from terrain_estimator.bags import BagReader, installed_definition
from terrain_estimator.cli import replay

SAMPLE = Path(__file__).parents[1] / "bags" / "sample"
STEPS = 300


def test_its_messages_are_those_of_this_version() -> None:
    with BagReader(SAMPLE) as reader:
        assert reader.finished
        assert {
            name: topic.definition and topic.definition.type_hash
            for name, topic in reader.topics.items()
        } == {
            name: installed_definition(topic.type_name).type_hash
            for name, topic in reader.topics.items()
        }, "record it anew: bags/README.md"


def test_a_replay_gives_the_recorded_estimates(tmp_path: Path) -> None:
    """Compare to the digits that another processor's rounding leaves."""
    assert replay.main([str(SAMPLE), "--out", str(tmp_path)]) == 0
    with BagReader(SAMPLE) as live, BagReader(tmp_path / "sample_estimates") as again:
        pairs = list(
            zip(
                *(
                    [one.decode(raw) for raw in one.messages(["/terrain_estimate"])]
                    for one in (live, again)
                ),
                strict=True,
            )
        )
    assert len(pairs) == STEPS
    for recorded, replayed in pairs:
        assert (replayed.cohesion, replayed.tan_phi) == pytest.approx(
            (recorded.cohesion, recorded.tan_phi), rel=1e-6
        )
        assert replayed.covariance == pytest.approx(recorded.covariance, rel=1e-5)
    assert (
        json.loads((tmp_path / "summary.json").read_text())["bags"][0]["outcomes"]["ACCEPTED"]
        == STEPS
    )


def test_a_replay_with_another_model_than_the_nodes_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay.main([str(SAMPLE), "--out", str(tmp_path), "--model", "paper_rover"]) == 3
    assert "its live estimates are of model mars_rover-" in capsys.readouterr().out
