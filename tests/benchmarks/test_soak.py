# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The soak names growth and shortfalls, and its core repeats a drive with healthy outcomes."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks.drives import long_drive
from benchmarks.soak import core
from benchmarks.soak.__main__ import verdict
from benchmarks.soak.core import ProcessSample
from benchmarks.soak.live import RoverSeries
from benchmarks.soak.page import HEADING, section
from benchmarks.soak.verdict import Ran, core_trends, live_trends
from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.topics import stamp_ns
from tests.drives import STEP_NS
from tests.faults.page import PAGE

SAMPLES = 120
WHOLE = Ran([24.0] * 3, [2.0] * 3, [40.0] * 3, 38.0)


def healthy(leak_mb: float = 0.0, abnormal: int = 0) -> list[ProcessSample]:
    generator = np.random.default_rng(1)
    places = range(SAMPLES)
    return [
        ProcessSample(
            place / 5.0,
            300.0 + generator.normal() + leak_mb * place / SAMPLES,
            500_000,
            400.0,
            abnormal * (place > 60),
            0,
            0,
        )
        for place in places
    ]


def test_a_leak_and_a_counter_of_the_core_are_named() -> None:
    assert [each.what for each in core_trends("rover1", healthy()) if each.grows] == []
    grown = [
        each.what for each in core_trends("rover1", healthy(leak_mb=30.0, abnormal=1)) if each.grows
    ]
    assert grown == ["core, rover1: memory_mb", "core, rover1: abnormal"]


def test_a_drifting_rate_and_lost_messages_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    series = RoverSeries("rover2")
    for place in range(SAMPLES):
        series.seconds.append(5.0 * place)
        series.estimator_mb.append(400.0)
        series.simulator_mb.append(350.0)
        series.rate_hz.append(40.0 - 4.0 * place / SAMPLES)
        series.counters.setdefault("lost", []).append(float(place // 100))
        series.counters.setdefault("resets", []).append(0.0)
    trends = list(live_trends(series))
    assert [each.what for each in trends if each.grows] == [
        "DDS, rover2: rate_hz",
        "DDS, rover2: lost",
    ]
    assert verdict(trends, WHOLE) == 1
    assert "GROWS DDS, rover2: rate_hz" in capsys.readouterr().out
    assert verdict([each for each in trends if not each.grows], WHOLE) == 0
    page = section(trends, WHOLE)
    assert "| DDS: lost | 1 | 1 | none (a count) | **yes** |" in page
    assert "| DDS: resets | 0 | 0 | none (a count) | no |" in page


@pytest.mark.parametrize(
    ("less", "words"),
    [
        (
            {"core_hours": [24.0, 5.0, 24.0]},
            "core, rover2: 5 simulated hours, at least 24 are wanted",
        ),
        ({"dds_hours": [2.0, 2.0, 1.0]}, "DDS, rover3: 1 simulated hours, at least 2 are wanted"),
        (
            {"dds_rate_hz": [25.0, 40.0, 40.0]},
            "DDS, rover1: 25 estimates/s, at least 39.6 are wanted",
        ),
    ],
)
def test_a_soak_that_falls_short_fails_and_says_so(
    less: dict[str, Any], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    short = dataclasses.replace(WHOLE, **less)
    assert verdict([], short) == 1
    assert f"SHORT {words}" in capsys.readouterr().out
    assert words in section([], short)


def test_the_page_has_the_section_that_a_soak_replaces() -> None:
    assert f"\n## {HEADING}\n" in PAGE.read_text(encoding="utf-8")


def test_a_long_drive_goes_on_with_its_stamps_and_sequences(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("benchmarks.drives.PIECE_S", 1.0)
    events = [
        (topic, stamp, message)
        for topic, stamp, message in long_drive(Types().make, 2.5)
        if topic == "wheel_slip"
    ]
    assert [message.sequence for _, _, message in events] == list(range(25))
    assert {later[1] - earlier[1] for earlier, later in itertools.pairwise(events)} == {STEP_NS}
    assert [stamp_ns(message) for _, _, message in events] == [stamp for _, stamp, _ in events]


def test_the_core_goes_on_over_the_seams_of_a_repeated_drive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("benchmarks.drives.PIECE_S", 3.0)
    make = Types().make
    # so short a run is over before the optimisation pays
    with torch.jit.optimized_execution(False):  # type: ignore[attr-defined]  # noqa: FBT003
        samples = core.run(
            Pipeline(load_model(), EstimatorConfig()),
            long_drive(make, 20.0),
            make,
            hours=9.0 / 3600.0,
            seconds=1e6,
        )
    assert samples[-1].hours == pytest.approx(9.0 / 3600.0)
    assert (samples[-1].abnormal, samples[-1].not_finite, samples[-1].troubled) == (0, 0, 0)
    assert samples[0].hours < samples[-1].hours
    assert min(sample.memory_mb for sample in samples) > 50.0
