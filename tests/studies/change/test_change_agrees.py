# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Other ground is no disagreement with the model."""

import torch

from studies.change.drives import Change, drive_over, places_of
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.observing import observations_of
from terramechanics.simulation.sensors import Noise, measure_drive
from tests.samples import sampled


def test_a_rover_that_crossed_a_border_agrees_with_its_model() -> None:
    """None of six drives or more disagrees, of 20 in `make test-long`: fewer than 40 and 14 % do.

    That is at a confidence of 95 %. Where only seconds with an accepted change were forgotten, 58 %
    of 120 drives disagreed 12 s after the last axle (seed 71000003): six would pass with a
    probability of 0.006 or less.
    """
    change, model = (
        Change("mars_rover", "compact_sand", "loose_sand"),
        load("mars_rover", AUTO).model,
    )
    generator, drives = torch.Generator().manual_seed(76_000_001), sampled(16, 48)
    drive = drive_over(model.rover, change, drives, generator)
    measurement = measure_drive(model.rover, drive.sample, Noise(), generator)
    places = [places_of(drive, index, change) for index in range(drives)]
    counting = [(index, place) for index, place in enumerate(places) if place is not None]
    assert len(counting) >= sampled(6, 20), "the others got stuck"
    for index, (first, last, end) in counting:
        estimator, accepted = Estimator(model, CoreConfig()), 0.0
        for k, observation in enumerate(
            observations_of(measurement, index)[: min(end, last + 250)]
        ):
            update = estimator.update(observation)
            if k >= first:
                accepted = max(accepted, update.estimate.change_probability)
                assert not update.disagreements, f"drive {index}, {(k - last) / 10:g} s after it"
        assert accepted > 0.5
