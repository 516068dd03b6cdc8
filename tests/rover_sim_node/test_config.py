# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator's parameters: defaults, ranges, and mistakes that are named."""

import dataclasses
import math

import pytest

from rover_sim_node.config import SimulatorConfig, SoilOverrides, configure
from terramechanics.loading import ConfigError
from terramechanics.soil import Soil


def test_nothing_given_is_the_default() -> None:
    assert configure({}) == SimulatorConfig()
    assert not SimulatorConfig().owns_clock


def test_dotted_names_reach_the_nested_values() -> None:
    config = configure({"soil_overrides.cohesion": 900, "change.soil": "compact_sand", "seed": 4, "real_time_factor": 2})
    assert config.soil_overrides.given() == {"cohesion": 900.0}
    assert config.change.soil == "compact_sand"
    assert config.owns_clock


def test_every_number_of_a_soil_can_be_replaced() -> None:
    numbers = {item.name for item in dataclasses.fields(Soil)} - {"name"}
    assert {item.name for item in dataclasses.fields(SoilOverrides)} == numbers
    assert SoilOverrides().given() == {}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"sed": 1}, "parameters: unknown key 'sed'"),
        ({"soil_overrides.cohesio": 1.0}, "parameters: soil_overrides: unknown key 'cohesio'; known keys are n, k_c"),
        ({"soil_overrides.cohesion": -1.0}, "soil_overrides: cohesion: -1 is outside its range"),
        ({"soil_overrides.n": math.inf}, "soil_overrides: n: inf is outside its range"),
        ({"rate": 0.0}, r"rate: 0 is outside its range: .* at least 1 and at most 50 \[Hz\]"),
        ({"seed": 1.5}, "seed: expected a whole number"),
        ({"seed": -1}, "seed: -1 is outside its range"),
        ({"publish_clock": 1}, "publish_clock: expected true or false"),
        ({"soil": 3}, "soil: expected a text"),
        ({"soil.name": "x", "soil": "y"}, "unknown key below 'soil'"),
        ({"soil": "y", "soil.name": "x"}, "unknown key 'soil.name': 'soil' has no parameters of its own"),
    ],
)
def test_a_wrong_parameter_is_refused_by_name(values: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        configure(values)
