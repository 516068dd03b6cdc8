# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Replay of recordings in which much is refused."""

import re
from pathlib import Path

import numpy as np
import pytest

from terrain_estimator.bags import Types
from terrain_estimator.cli import replay
from terrain_estimator.messaging.messages import Status
from terrain_estimator.offline.replay_result import Replay
from terrain_estimator.offline.summary import print_table
from terrain_estimator.outcome import Outcome
from tests.drives import START_NS, Event, drive_messages, write_bag
from tests.terrain_estimator.offline.replays import (
    SECONDS,
    estimates,
    run,
)


def test_bad_messages_are_counted_and_the_outputs_stay_sound(tmp_path: Path) -> None:
    types = Types()
    events = list(drive_messages(types.make, SECONDS))
    draw = np.random.default_rng(5)
    values = [np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, -1e300, 1e-320]
    for topic, _, message in events:
        field = {"wheel_slip": "slip", "wheel_sinkage": "sinkage", "joint_states": "effort"}.get(
            topic
        )
        if field and draw.random() < 0.2:
            getattr(message, field)[draw.integers(6)] = draw.choice(values)
        if topic == "odom" and draw.random() < 0.1:
            message.twist.twist.linear.x = float(draw.choice(values))
    code, summary = run(tmp_path / "out", write_bag(tmp_path / "bad", events, types))
    assert code == 0
    outcomes = summary["bags"][0]["outcomes"]
    assert sum(outcomes.values()) + summary["bags"][0]["waiting"] == 80
    assert outcomes["NOT_FINITE"] > 0
    for message in estimates(tmp_path / "out/bad_estimates"):
        assert np.isfinite(message.covariance).all()
        assert np.linalg.eigvalsh(message.covariance.reshape(2, 2))[0] >= 0.0


def test_many_refused_seconds_raise_the_question_of_the_model(
    capsys: pytest.CaptureFixture[str],
) -> None:
    drive = Replay(Path("drive"), Path("out"))
    settled = drive.history.settled
    settled.seconds_taken, settled.seconds_refused = 90, 10
    print_table([drive])
    assert "--model" not in capsys.readouterr().out
    settled.seconds_taken, settled.seconds_refused = 88, 12
    print_table([drive])
    assert (
        "drive: 12 of 100 seconds of driving were refused: check that the model (--model) is for"
        in capsys.readouterr().out
    )


def wrong_torques(types: Types, first_s: float, seconds: float) -> list[Event]:
    """Return a drive whose torques are ten times too large from ``first_s`` on."""
    events = list(drive_messages(types.make, seconds))
    for topic, stamp_ns, message in events:
        if topic == "joint_states" and stamp_ns >= START_NS + first_s * 1e9:
            message.effort = 10.0 * message.effort
    return events


def test_a_model_that_does_not_fit_gives_no_estimate_and_is_named_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    types = Types()
    drive = write_bag(tmp_path / "drive", wrong_torques(types, 2.0, 20.0), types)
    report = tmp_path / "report.html"
    code, summary = run(tmp_path / "out", drive, "--report", report)
    assert code == replay.NOTHING
    [result] = summary["bags"]
    assert (result["estimates"], result["used"], result["waiting"]) == (200, 20, 0)
    assert (result["seconds_taken"], result["seconds_refused"]) == (2, 18)
    assert result["outcomes"] == {"ACCEPTED": 20, "GATED": 180}
    assert (result["status"], result["estimate"]) == ("DISAGREES", {})
    finding = "the model does not fit this rover or ground: 2 of the last 20 seconds of driving"
    assert result["disagreements"] == [f"{finding} were taken"]
    told = capsys.readouterr().out
    assert f"NO ESTIMATE, {finding} were taken: check the model, the rover file" in told
    assert re.search(r"drive .* 200 .* 2 of 20 .* 180 .* - .* - .* DISAGREES", told)
    page = report.read_text()
    assert f"T{finding[1:]} were taken" in page
    assert "c and tan phi are the prior" in page
    assert "identified</strong>" not in page
    last = estimates(tmp_path / "out/drive_estimates")[-1]
    assert last.status == Status.DISAGREES
    assert (last.cohesion_identified, last.tan_phi_identified) == (False, False)


def test_a_second_that_has_not_ended_is_neither_used_nor_refused(tmp_path: Path) -> None:
    types = Types()
    short = write_bag(tmp_path / "short", drive_messages(types.make, 0.7), types)
    report = tmp_path / "report.html"
    code, summary = run(tmp_path / "out", short, "--report", report)
    assert code == replay.NOTHING, "the estimate is the prior"
    [result] = summary["bags"]
    assert (result["used"], result["outcomes"], result["waiting"]) == (0, {}, 7)
    assert "No second of driving has ended" in report.read_text()


def test_the_table_names_a_bag_as_its_folder_is_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "hügel [alt]"
    folder.mkdir()
    monkeypatch.chdir(folder)
    drive = Replay(Path(), Path("out"))
    drive.history.settled.outcomes[Outcome.GATED] = 1
    print_table([drive])
    assert re.findall(r"hügel \[alt\].*", capsys.readouterr().out)[1].startswith(
        "hügel [alt]: 1 x GATED"
    )
