# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Two effects at once, and pairs of which one member has no size."""

import torch

from terrain_estimator.discovery.evidence.search import foresee, further, members, search
from terrain_estimator.discovery.evidence.verdict import Verdict, read_thresholds
from terrain_estimator.discovery.hypotheses.library import singles, together
from terrain_estimator.discovery.report.investigation import investigate
from tests.terrain_estimator.discovery.known import SIZES, study


def quiet(_share: float, _label: str) -> None:
    """Report no progress."""


def test_an_effect_that_a_search_from_nothing_misses_is_found_from_a_size_that_matters() -> None:
    runs = study("multipass", bogie_angle=False)
    with torch.inference_mode():
        foreseen = foresee(runs, singles(("failed_wheel", "multipass", "exit_angle")), quiet)
        near = search(runs, foreseen, quiet)
        again = further(runs, foreseen, near, quiet)
    assert near[0].hypothesis.names == ("failed_wheel",)
    assert [each.hypothesis.names for each in again] == [("multipass",)]
    assert again[0].fit.log_evidence > near[0].fit.log_evidence + 100.0
    [(_, size, deviation)] = again[0].sizes
    assert abs(size - SIZES["multipass"]) < 2.0 * deviation


def test_a_pair_with_a_member_of_no_size_is_the_other_one_alone() -> None:
    """Fitted from nothing, multipass sticks far below failed_wheel; from the pair's point not."""
    runs = study("multipass", bogie_angle=False)
    failed, multipass = singles(("failed_wheel", "multipass"))[::3]
    with torch.inference_mode():
        both = runs.explain(together(failed, multipass), after=runs.explain(failed))
        alone = members(runs, both)
        found = investigate(runs, singles(("failed_wheel", "multipass")), read_thresholds(), quiet)
    assert [each.hypothesis for each in alone] == [failed, multipass]
    assert alone[1].fit.log_evidence > runs.explain(multipass).fit.log_evidence + 200.0
    assert alone[1].fit.log_evidence > both.fit.log_evidence - 2.0
    assert found.judgement.verdict is Verdict.NAMED
    assert [each.label for each in found.judgement.named] == ["multipass"]
