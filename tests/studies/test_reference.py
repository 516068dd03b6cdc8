# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The recursion beside a posterior on a grid, from the same rows."""

from studies.accuracy.scores import draw_drives, observation_times, row_mask
from studies.batched import run
from studies.reference import grid_posterior
from terrain_estimator.learning.restore import physics_alone
from terramechanics.presets import load_rover, load_soil
from tests.samples import sampled


def test_the_recursion_is_within_a_fifth_of_a_standard_deviation_of_the_grid_posterior() -> None:
    """Drives of 40 s over hills, rows v + L + M, exact constants: deviations within 10 %."""
    count = sampled(2, 5)
    for name, soil_name in (("mars_rover", "loose_sand"), ("paper_rover", "loose_sand")):
        rover, soil = load_rover(name), load_soil(soil_name)
        drives = draw_drives(rover, soil, "S1", count, 0.0, 11)
        model, mask = physics_alone(rover, soil, exact=True), row_mask("v+L+M", 3)
        trace = run(model, drives.tasks.measured, observation_times(), drives.ends, mask)
        for episode in range(count):
            mean, covariance = trace.mean[episode, -1], trace.covariance[episode, -1]
            reference = grid_posterior(
                model, drives.tasks.measured[episode], int(drives.ends[episode]), mask
            )
            sd = reference.covariance.diagonal().sqrt()
            assert reference.edge < 1e-4, (name, episode)
            assert ((mean - reference.mean).abs() / sd < 0.2).all(), (name, episode)
            assert ((covariance.diagonal().sqrt() / sd - 1.0).abs() < 0.1).all(), (name, episode)
