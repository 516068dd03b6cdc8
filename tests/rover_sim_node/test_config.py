# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator's parameters: defaults, and names that reach nested values."""

import dataclasses

from rover_parameters.parameters import configure
from rover_sim_node.config import SimulatorConfig, SoilOverrides
from terramechanics.terrain.soil import Soil


def test_nothing_given_owns_no_clock() -> None:
    assert not SimulatorConfig().owns_clock


def test_dotted_names_reach_the_nested_values() -> None:
    config = configure(
        SimulatorConfig,
        {
            "soil_overrides.cohesion": 900,
            "change.soil": "compact_sand",
            "seed": 4,
            "real_time_factor": 2,
        },
    )
    assert config.soil_overrides.given() == {"cohesion": 900.0}
    assert config.change.soil == "compact_sand"
    assert config.owns_clock


def test_a_drive_of_any_duration_ends() -> None:
    steps = [
        configure(SimulatorConfig, {"duration": duration}).steps
        for duration in (0.0, 0.04, 0.1, 60.0)
    ]
    assert steps == [0, 1, 1, 600], "0 does not end; what is shorter than a sample did not either"


def test_every_number_of_a_soil_can_be_replaced() -> None:
    numbers = {item.name for item in dataclasses.fields(Soil) if item.type is float}
    assert {item.name for item in dataclasses.fields(SoilOverrides)} == numbers
    assert SoilOverrides().given() == {}
