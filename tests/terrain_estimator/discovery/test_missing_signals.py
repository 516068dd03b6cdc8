# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Signals that runs lack, judged against the same runs with them."""

import pytest
import torch

from terrain_estimator.discovery.evidence.isolability import between, signatures, stages_of
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import read_thresholds
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.next_drive.manoeuvres import MANOEUVRES
from terrain_estimator.discovery.next_drive.missing_signals import (
    lacking,
    missing_signals,
    without_signals,
)
from terrain_estimator.discovery.next_drive.next_drive import next_drives
from terrain_estimator.discovery.runs import cut
from tests.terrain_estimator.discovery.known import LOOSE, MARS, drives, study


def without(signal: str) -> Study:
    nominal = nominal_of(MARS, LOOSE)
    runs = [without_signals(run, (signal,), MARS.axles) for run in drives("")]
    with torch.inference_mode():
        return Study(nominal, [cut(run, nominal.contact) for run in runs])


@pytest.mark.parametrize(
    ("signal", "names", "separates"),
    [
        ("bogie angle", ("slope_bias", "payload"), True),
        ("motor torque", ("slope_bias", "drive_drag"), True),
        ("acceleration", ("payload", "grousers"), True),
    ],
)
def test_a_missing_signal_would_tell_apart_what_it_tells_apart_where_it_is_measured(
    signal: str, names: tuple[str, str], *, separates: bool
) -> None:
    doubtful, poor, whole = singles(names), without(signal), study("")
    assert lacking(poor.runs) == (signal,)
    with torch.inference_mode():
        [found] = missing_signals(poor, doubtful, poor.nothing, read_thresholds().apart)
        stages = stages_of(whole.nothing)
        marks = signatures(whole, doubtful, whole.nothing)
    true, other = ((doubtful[0].label == found.pair[0]) ^ 1, doubtful[0].label == found.pair[0])
    assert found.nats == pytest.approx(between(stages, marks[true], marks[other]), rel=0.3)
    assert found.separates is separates
    assert found.nats > found.without + 3.0


def test_an_accelerometer_hardly_separates_a_tilt_that_it_may_have_from_pushed_soil() -> None:
    doubtful, poor = singles(("slope_bias", "bulldozing")), without("acceleration")
    with torch.inference_mode():
        [found] = missing_signals(poor, doubtful, poor.nothing, read_thresholds().apart)
    assert not found.separates
    assert found.without < found.nats < found.without + 3.0


def test_a_signal_that_adds_nothing_does_not_separate_and_one_that_is_there_is_not_missing() -> (
    None
):
    """An accelerometer knows nothing of drags that the velocity does not show."""
    drags, poor = singles(("drive_drag", "coulomb_drag")), without("acceleration")
    with torch.inference_mode():
        [found] = missing_signals(poor, drags, poor.nothing, read_thresholds().apart)
        assert not found.separates
        assert missing_signals(study(""), drags, study("").nothing, 0.08) == []
        assert missing_signals(poor, drags[:1], poor.nothing, 0.08) == []


def test_next_drives_have_no_signal_that_the_runs_lack() -> None:
    """Without a motor torque two speeds tell little of two drags."""
    drags, poor = singles(("drive_drag", "coulomb_drag")), without("motor torque")
    tried = [each for each in MANOEUVRES if each.name == "two_speeds"]
    with torch.inference_mode():
        [blind] = next_drives(poor, drags, poor.nothing, tried)
        [whole] = next_drives(study(""), drags, study("").nothing, tried)
    assert blind.nats < 0.5 * whole.nats
