# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of false names: its wheel against terramechanics, its tables and its limits."""

import numpy as np
import pytest
import torch

from studies.false_names.drawn import FAMILIES, HIDDEN, draw
from studies.false_names.table import limits
from studies.false_names.wheel import Extra, Soil, Wheel
from terrain_estimator.discovery.hypotheses.library import LibraryEffect
from terrain_estimator.discovery.single_wheel.cells import Rig, Row, cells_of, wheel_alone
from terramechanics.presets import load_rover
from terramechanics.terrain.soil import Soil as LibrarySoil

SLIPS, LOAD = (-0.3, 0.0, 0.1, 0.3, 0.6), 80.0


@pytest.mark.parametrize("tip", [0.0, 0.015])
def test_where_both_have_the_law_of_wong_and_reece_the_study_s_wheel_is_terramechanics(
    tip: float,
) -> None:
    """Two codes that share nothing; with a tip that of shear_at_tips is compared, too."""
    soil = Soil(
        "power", "janosi", "shifted", n=1.0, stiffness=2e4, depth=0.02, bend=0.01, crust=0.0,
        shear_length=0.01, peak=0.0, c1=0.3, c2=0.2, exit_share=0.0, cohesion_pa=500.0, tan_phi=0.6,
    )  # fmt: skip
    wheel = Wheel(0.15, 0.1, soil, Extra(tip=tip))
    stated = LibrarySoil(
        "s", n=1.0, k_c=0.0, k_phi=1e6, shear_modulus=0.01, c1=0.3, c2=0.2, cohesion=500.0,
        tan_phi=0.6,
    )  # fmt: skip
    rover = wheel_alone(load_rover("mars_rover"), 0.15, 0.1)
    bed = Rig(rover, stated, (0.2,) * 5, (1.0,) * 4)
    rows = [Row("t", "1", slip, LOAD, 0.5, 0.01, 0.0, torque=0.0) for slip in SLIPS]
    effect = LibraryEffect("grousers", competing=0).acting([tip / 0.15])
    found = bed.states(
        cells_of(rows), stated.strength().unsqueeze(0), stated.constants().unsqueeze(0), [effect]
    )[0]
    expected = torch.tensor([wheel.state(slip, LOAD) for slip in SLIPS], dtype=torch.float64)
    # the study's sums have 160 points
    torch.testing.assert_close(found[:, [0, 1, 3]], expected, rtol=2e-3, atol=2e-3)


def test_what_is_hidden_changes_the_tested_table_alone_and_is_of_a_known_family() -> None:
    assert set(HIDDEN) == set(FAMILIES)
    for hidden in HIDDEN:
        drawn = draw(np.random.default_rng(3), hidden)
        assert drawn.reference
        assert drawn.tested.state(0.3, 50.0) != drawn.plain.state(0.3, 50.0), hidden
    assert (nothing := draw(np.random.default_rng(3))).tested == nothing.plain


def test_confidence_limits_are_those_of_a_binomial_share() -> None:
    assert limits(0, 200) == pytest.approx((0.0, 0.01828), abs=1e-5)  # 1 - 0.025^(1 / 200)
    low, high = limits(5, 100)
    assert low < 0.05 < high
