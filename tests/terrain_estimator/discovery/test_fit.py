# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fits of hypotheses to drives of known truth; tests/hidden has the rates of right verdicts."""

import math

import pytest
import torch

from terrain_estimator.discovery.evidence.study import Candidate
from terrain_estimator.discovery.hypotheses.library import (
    OTHER_LAW,
    OTHER_SOIL_LAW,
    SOIL_LAWS,
    Hypothesis,
    LibraryEffect,
    singles,
)
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.runs import RecordedRun, RunError, cut
from tests.terrain_estimator.discovery.known import LOOSE, MARS, SIZES, drives, study


def best_of(name: str, hypotheses: list[Hypothesis]) -> tuple[Candidate, float]:
    """Return the most probable hypothesis and its log evidence over nothing."""
    with torch.inference_mode():
        found = max(
            (study(name).explain(each) for each in hypotheses),
            key=lambda each: each.fit.log_evidence,
        )
    return found, found.fit.log_evidence - study(name).nothing.fit.log_evidence


def test_where_nothing_is_missing_rows_fit_to_their_noise_and_no_effect_is_worth_its_freedom() -> (
    None
):
    nothing = study("").nothing.fit
    assert 0.6 < nothing.objective / nothing.degrees < 1.1
    for unknowns, strength in zip(nothing.point.runs, ((2.5, 0.6), (1.5, 0.7)), strict=True):
        assert abs(float(unknowns.theta[0]) - strength[0]) < 0.5
        assert abs(float(unknowns.theta[1]) - strength[1]) < 0.1
    assert best_of("", singles(("drive_drag", "slope_bias", "payload")))[1] < 2.0


@pytest.mark.parametrize("name", ["drive_drag", "slope_bias"])
def test_the_effect_that_is_missing_is_found_at_its_size(name: str) -> None:
    found, evidence = best_of(name, singles(("drive_drag", "slope_bias", "bulldozing")))
    assert found.hypothesis.names == (name,)
    assert evidence > 20.0
    by_fit = float(found.fit.covariance[0, 0].sqrt())
    _, size, deviation = found.sizes[0]
    assert abs(size - SIZES[name]) < 4.0 * by_fit
    law = OTHER_SOIL_LAW if name in SOIL_LAWS else OTHER_LAW
    assert deviation == pytest.approx(math.hypot(by_fit, law * size))


def test_the_fit_does_not_depend_on_where_the_search_for_the_size_begins() -> None:
    drag = Hypothesis((LibraryEffect("drive_drag"),))
    with torch.inference_mode():
        first = study("drive_drag").explain(drag)
        again = study("drive_drag").refine(first)
    assert again.sizes[0][1] == pytest.approx(first.sizes[0][1], abs=0.5 * first.sizes[0][2])


def test_a_run_of_a_few_seconds_is_refused_with_its_name() -> None:
    run = drives("")[0]
    short = RecordedRun("field_7", run.packed[:30], run.wheel_rate[:30], run.time[:30])
    with pytest.raises(RunError, match="field_7: 3 whole seconds"):
        cut(short, nominal_of(MARS, LOOSE).contact)


def test_blocks_are_joined_by_velocities_where_the_run_is_not_interrupted() -> None:
    run = drives("")[0]
    packed = run.packed.clone()
    packed[125, 0] = torch.nan
    blocks = cut(
        RecordedRun("run", packed, run.wheel_rate, run.time), nominal_of(MARS, LOOSE).contact
    )
    assert blocks.packed.shape[0] == 12 + 12
    assert blocks.velocities == blocks.packed.shape[0] + 2
    assert torch.equal(blocks.ends[11:13], torch.tensor([[11, 12], [13, 14]]))
