# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Two effects at once, and pairs of which one member has no size."""

import torch

from terrain_estimator.discovery.evidence.search import foresee, further, members, search
from terrain_estimator.discovery.evidence.verdict import Verdict, read_thresholds
from terrain_estimator.discovery.hypotheses.library import singles, together
from terrain_estimator.discovery.report.finding import _as_answer, exchanged, explain_singly
from terrain_estimator.discovery.report.investigation import investigate
from tests.terrain_estimator.discovery.known import SIZES, study


def quiet(_share: float, _label: str) -> None:
    """Report no progress."""


def test_a_law_that_is_far_from_linear_is_found_by_whole_steps() -> None:
    """By steps that must each fit better the search from nothing ended at failed_wheel."""
    runs = study("multipass", bogie_angle=False)
    with torch.inference_mode():
        foreseen = foresee(runs, singles(("failed_wheel", "multipass", "exit_angle")), quiet)
        found = search(runs, foreseen, quiet)
    assert foreseen[0].hypothesis.names != ("multipass",)
    assert found[0].hypothesis.names == ("multipass",)
    assert runs.gain(found[0]) > runs.gain(found[1]) + 100.0
    [(_, size, deviation)] = found[0].sizes
    assert abs(size - SIZES["multipass"]) < 2.0 * deviation


def test_a_second_effect_that_a_search_beside_the_first_misses_is_found_from_such_a_size() -> None:
    runs = study("multipass", bogie_angle=False)
    (scale,) = singles(("odometry_scale",))
    others = [together(scale, each) for each in singles(("failed_wheel", "multipass"))]
    with torch.inference_mode():
        first = runs.explain(scale)
        foreseen = foresee(runs, others, quiet, first)
        near = search(runs, foreseen, quiet, first)
        again = further(runs, foreseen, near, quiet, first)
    assert "multipass" not in near[0].hypothesis.names
    assert [each.hypothesis.names for each in again] == [("odometry_scale", "multipass")]
    assert runs.gain(again[0]) > runs.gain(near[0]) + 100.0
    (_, (_, size, deviation)) = again[0].sizes
    assert abs(size - SIZES["multipass"]) < 2.0 * deviation


def test_a_pair_with_a_member_of_no_size_is_the_other_one_alone() -> None:
    """Fitted from nothing, multipass stops short of its best fit; from the pair's point not."""
    runs = study("multipass", bogie_angle=False)
    failed, multipass = singles(("failed_wheel", "multipass"))[::3]
    with torch.inference_mode():
        both = runs.explain(together(failed, multipass), after=runs.explain(failed))
        alone = members(runs, both)
        found = investigate(runs, singles(("failed_wheel", "multipass")), read_thresholds(), quiet)
    assert [each.hypothesis for each in alone] == [failed, multipass]
    assert alone[1].fit.log_evidence > runs.explain(multipass).fit.log_evidence + 100.0
    assert alone[1].fit.log_evidence > both.fit.log_evidence - 2.0
    assert found.judgement.verdict is Verdict.NAMED
    assert [each.label for each in found.judgement.named] == ["multipass"]


def test_a_pair_whose_first_effect_only_looks_like_the_hidden_one_is_left_for_the_right_one() -> (
    None
):
    """Alone slope_bias may gain more than bulldozing; beside coulomb_drag the latter does."""
    runs = study("bulldozing+coulomb_drag")
    slope, bulldozing, coulomb = singles(("slope_bias", "bulldozing", "coulomb_drag"))
    with torch.inference_mode():
        wrong = runs.explain(together(slope, coulomb), after=runs.explain(slope))
        rule, alone = read_thresholds(), members(runs, wrong)
        found = exchanged(runs, [slope, bulldozing, coulomb], wrong, alone, rule, quiet)
    assert [each.hypothesis.names for each in found] == [("coulomb_drag", "bulldozing")]
    assert runs.gain(found[0]) > runs.gain(wrong) + rule.anything


def test_a_pair_of_an_exchange_is_no_answer_where_its_new_effect_alone_explains_as_much() -> None:
    """Beside coulomb_drag bulldozing is better than slope_bias, but it was not fitted alone."""
    runs = study("bulldozing+coulomb_drag")
    slope, bulldozing, coulomb = singles(("slope_bias", "bulldozing", "coulomb_drag"))
    rule = read_thresholds()
    with torch.inference_mode():
        before = explain_singly(runs, [slope, coulomb], rule, quiet)
        wrong = runs.explain(together(slope, coulomb), after=before.found[0])
        found = exchanged(runs, [slope, bulldozing, coulomb], wrong, before.found, rule, quiet)
        after, answer = _as_answer(runs, before, found, rule)
    assert [each.hypothesis for each in before.found] == [slope, coulomb]
    assert answer is None
    assert after.found[0].hypothesis == bulldozing
    assert after.gains.best > before.gains.best + 100.0
    assert runs.gain(found[0]) < after.gains.best + rule.anything
