# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Shortcuts of the search against the whole evaluations that they replace."""

import dataclasses

import pytest
import torch

from terrain_estimator.discovery.evidence.common_constants import (
    WithCommonConstants,
    changed_constants,
    fit_together,
    relative_change,
)
from terrain_estimator.discovery.hypotheses.equations import Query
from terrain_estimator.discovery.hypotheses.library import NOTHING, singles
from terrain_estimator.discovery.hypotheses.next_effect import Known, NextEffectTask
from terrain_estimator.discovery.leftover.flexible import no_columns
from terramechanics.terrain.soil import CONSTANTS
from tests.terrain_estimator.discovery.known import LOOSE, study

NONE = torch.zeros(0, dtype=torch.float64)


def queries(sizes: tuple[float, ...], steps: tuple[float, ...]) -> list[Query]:
    """Return queries where "nothing is missing" was last evaluated, around the same inputs."""
    fit = study("").nothing.fit
    return [
        Query(own, sizes, NONE, columns, steps, before.by_constant, before.around)
        for own, columns, before in zip(
            fit.origin.runs, no_columns(study("").runs).columns, fit.equations, strict=True
        )
    ]


def test_a_change_in_common_is_the_same_as_that_of_every_run() -> None:
    sd = study("").nominal.prior.constants_sd
    change = torch.tensor([0.05, 0.1, 0.0, -0.2, 0.0], dtype=torch.float64)
    factor = torch.cat([1.0 + change[:1], torch.exp(change[1:])])  # of n itself, else a logarithm
    slope = torch.cat([torch.ones(1, dtype=torch.float64), torch.exp(change[1:])])
    together = WithCommonConstants(
        study("").evaluate(NOTHING), (0, 0), torch.zeros_like(change), sd
    )
    with torch.inference_mode():
        found = together(queries(tuple(change.tolist()), (0.0,) * 5))
        own = [
            dataclasses.replace(
                each,
                unknowns=dataclasses.replace(
                    each.unknowns, kappa=each.unknowns.kappa + (factor - 1.0) / sd
                ),
            )
            for each in queries((), ())
        ]
        expected = study("").evaluate(NOTHING)(own)
    for each, alone in zip(found, expected, strict=True):
        assert each.misfit == alone.misfit
        assert torch.allclose(each.gradient[-5:], alone.gradient[2:7] * slope / sd)
        assert torch.equal(each.gradient[:-5], alone.gradient)
        assert torch.allclose(
            each.hessian[-5:, -5:].diagonal(),
            (slope / sd).square() * alone.hessian[2:7, 2:7].diagonal(),
        )


def test_changes_count_from_the_constants_as_told_wherever_the_rows_are_evaluated() -> None:
    """Runs without a scatter of their own have one misfit on the soil as told and on another."""
    nominal = study("").nominal
    reached = torch.tensor([-0.1, 0.2, 0.1, 0.15, -0.05], dtype=torch.float64)
    there = dict(zip(CONSTANTS, changed_constants(nominal, LOOSE, reached).tolist(), strict=True))
    soil = LOOSE.with_values(**there)
    assert torch.allclose(relative_change(nominal, LOOSE, soil), reached)
    at = dataclasses.replace(nominal, revised=((LOOSE, soil),))
    change = reached + 0.02
    asked = [
        dataclasses.replace(
            each,
            unknowns=dataclasses.replace(
                each.unknowns, kappa=torch.zeros_like(each.unknowns.kappa)
            ),
            known=None,
        )
        for each in queries(tuple(change.tolist()), (0.0,) * 5)
    ]
    places, sd = (0, 0), nominal.prior.constants_sd
    with torch.inference_mode():
        near = WithCommonConstants(study("").evaluate(NOTHING, at), places, reached, sd)(asked)
        far = WithCommonConstants(study("").evaluate(NOTHING), places, 0.0 * reached, sd)(asked)
    for one, other in zip(near, far, strict=True):
        assert one.misfit == pytest.approx(other.misfit, rel=1e-6)
        assert torch.allclose(one.gradient[-5:], other.gradient[-5:], rtol=1e-3)


def test_where_the_soil_file_is_right_the_constants_in_common_stay() -> None:
    with torch.inference_mode():
        found = fit_together(study(""), NOTHING, study("").nothing.fit.point, study("").nominal)
    change = found.point.shared
    assert float((change / found.covariance.diagonal().sqrt()).abs().max()) < 3.0
    constants = changed_constants(study("").nominal, LOOSE, torch.zeros_like(change))
    assert torch.equal(constants, LOOSE.constants())


@pytest.mark.parametrize("name", ["drive_drag", "slope_bias"])
def test_one_more_effect_has_the_equations_of_a_whole_evaluation(name: str) -> None:
    hypothesis = singles((name,))[0]
    steps = hypothesis.shared().step
    task = NextEffectTask(study("").nominal, hypothesis, steps)
    fit = study("").nothing.fit
    with torch.inference_mode():
        whole = study("").evaluate(hypothesis)(queries((0.0,) * len(steps), steps))
        short = [
            task(run, Known(own, (), each))
            for run, own, each in zip(study("").runs, fit.origin.runs, fit.equations, strict=True)
        ]
    for each, expected in zip(short, whole, strict=True):
        assert torch.allclose(each.jacobian, expected.jacobian, rtol=1e-6, atol=1e-8)
        assert torch.allclose(each.gradient, expected.gradient, rtol=1e-5, atol=1e-5)
