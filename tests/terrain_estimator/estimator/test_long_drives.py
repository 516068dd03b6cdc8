# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What is not called identified after long drives, because intervals were not shown to hold."""

import pytest

from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, CoreConfig
from terrain_estimator.estimator import estimator as module
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.update import Update
from terramechanics.presets import load_soil
from tests.terrain_estimator.drives import drive_observations

WITHOUT = CoreConfig(use_torque=False, use_moments=False)


def last(config: CoreConfig) -> Update:
    """Return the last update of a drive of 40 s of the paper's rover."""
    model = load("paper_rover", AUTO).model
    estimator = Estimator(model, config)
    observations = drive_observations(model.rover, load_soil("loose_sand"), 40.0, 3)
    return [estimator.update(each) for each in observations][-1]


def test_a_short_drive_without_torques_and_moments_identifies() -> None:
    update = last(WITHOUT)
    assert any(update.estimate.identified)
    assert update.unconfirmed == ""


@pytest.mark.parametrize("config", [WITHOUT, CoreConfig(), CoreConfig(use_torque=False)])
def test_after_that_only_torques_or_moments_identify(
    monkeypatch: pytest.MonkeyPatch, config: CoreConfig
) -> None:
    monkeypatch.setattr(module, "SHOWN_S", 20.0)
    update = last(config)
    assert any(update.estimate.identified) == (config is not WITHOUT)
    assert update.unconfirmed == (
        "without torques and moments intervals hold for 20 s of driving, and not for an hour: use"
        " one of them"
        if config is WITHOUT
        else ""
    )
