# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The prior of a model, in the parameters of its posterior."""

import dataclasses

import pytest

from terrain_estimator.model.hypotheses import Hypotheses
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.parameters import parameter_layout
from terrain_estimator.model.prior import DEFAULT_PRIOR

LAYOUT = parameter_layout(2, 5, 0)


@pytest.mark.parametrize("name", ["mass_sd", "centre_of_mass_sd", "acceleration_bias_sd"])
def test_a_deviation_of_the_rover_is_a_precision_of_the_posterior(name: str) -> None:
    place = ("mass_sd", "centre_of_mass_sd", "acceleration_bias_sd").index(name)
    for deviation in (0.5, 0.01):
        prior = dataclasses.replace(DEFAULT_PRIOR, **{name: deviation})
        precision = Hypotheses(prior, LAYOUT, 1).rover_precision
        assert float(precision[place]) == pytest.approx(1.0 / deviation**2, rel=1e-12)
        assert len(precision) == 4


@pytest.mark.parametrize("name", ["mars_rover", "paper_rover"])
def test_the_models_that_ship_have_the_default_prior(name: str) -> None:
    assert load_model(name).metadata.prior == DEFAULT_PRIOR
    varying = dataclasses.replace(DEFAULT_PRIOR, ground_variation=0.02)
    assert load_model(f"{name}_on_varying_ground").metadata.prior == varying


def test_the_hypotheses_together_have_mean_and_variance_of_the_prior() -> None:
    """In units of its deviation, also those that are started anew later."""
    bank = Hypotheses(DEFAULT_PRIOR, LAYOUT, 1)
    weight = bank.offset_log_weight.exp()
    assert float(weight.sum()) == pytest.approx(1.0)
    assert (weight @ bank.offsets).tolist() == pytest.approx([0.0, 0.0], abs=1e-12)
    spread = weight @ bank.offsets**2 + bank.offset_spread**2
    assert spread.tolist() == pytest.approx([1.0, 1.0])
    anew = (bank.restart_offsets**2).mean(0) + bank.restart_spread**2
    assert bank.restart_offsets.mean(0).tolist() == pytest.approx([0.0, 0.0])
    assert anew.tolist() == pytest.approx([1.0, 1.0])


def test_cohesion_is_in_kilopascal_inside_and_tan_phi_a_plain_number() -> None:
    assert Hypotheses(DEFAULT_PRIOR, LAYOUT, 1).unit.tolist() == [1000.0, 1.0]
