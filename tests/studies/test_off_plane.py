# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of turns and cross slopes: what it measures is the simulated rover's."""

from pathlib import Path

import numpy as np
import pytest

from studies.off_plane import DRIVES, KINDS, drives, judge
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.model.model_file import load_model
from tests.rovers import FOUR_WHEELS
from tests.terrain_estimator.kinds import exported

SAMPLES = 25


def test_a_straight_drive_is_taken_and_a_turn_or_a_lean_refused(tmp_path: Path) -> None:
    """600 samples each, one seed: noise is to refuse fewer than one of the straight ones."""
    kind = KINDS[0]
    assert kind.rover == FOUR_WHEELS.name
    model = load_model(str(exported(FOUR_WHEELS, tmp_path)))
    shares = []
    for yaw_rate, lean in ((0.0, 0.0), (0.4, 0.0), (0.0, 10.0)):
        found, strength = drives(kind, yaw_rate, lean, SAMPLES)
        assert strength.shape == (DRIVES, 2)
        judged = judge(model, found, strength, CoreConfig())
        shares.append(judged.refused)
    straight, turn, slope = shares
    assert straight < 0.02
    assert turn > 0.7  # it begins at rest
    assert slope > 0.9


def test_what_is_measured_of_a_turn_is_noisy_about_the_truth() -> None:
    kind = KINDS[1]
    found, _ = drives(kind, 0.02, 0.0, SAMPLES)
    last = [each[-1] for each in found]
    assert np.mean([each.yaw_rate for each in last]) == pytest.approx(0.02, rel=0.2)
    assert np.mean([each.roll for each in last]) == pytest.approx(0.0, abs=0.005)
    found, _ = drives(kind, 0.0, 6.0, SAMPLES)
    assert np.mean([each[-1].roll for each in found]) == pytest.approx(np.radians(6.0), abs=0.005)
