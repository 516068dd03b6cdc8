# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The rule for names of wheel tables: families of laws, and prior odds."""

import numpy as np
import pytest

from terrain_estimator.discovery.evidence.verdict import Verdict
from terrain_estimator.discovery.hypotheses.library import Hypothesis, LibraryEffect
from terrain_estimator.discovery.single_wheel.families import (
    APART,
    NAME,
    Weighed,
    families,
    judge,
)
from terrain_estimator.discovery.single_wheel.fit import Explained

NONE = np.zeros(0)


def law(name: str, evidence: float, competing: int | None = None) -> Explained:
    hypothesis = Hypothesis((LibraryEffect(name, competing=competing),))
    return Explained(hypothesis, NONE, NONE, evidence, NONE, ("sinkage", "slip"))


def weighed(*laws: Explained, model_error: float = 0.0) -> Weighed:
    return Weighed(-model_error, 0.0, tuple(families(laws)))


def test_more_laws_in_one_family_do_not_change_the_odds_between_families() -> None:
    one = judge(weighed(law("grousers", 9.0), law("exit_angle", 8.0)), {})
    three = judge(
        weighed(law("exit_angle", 8.0), *(law("grousers", 9.0, k) for k in (None, 0, 1))), {}
    )
    assert three.probabilities == pytest.approx(one.probabilities)
    assert sum(one.probabilities.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("gain", "second", "model_error", "verdict"),
    [
        (NAME + 1.0, 0.0, 0.0, Verdict.NAMED),
        (NAME + 1.0, NAME + 1.0 - 0.9 * APART, 0.0, Verdict.CONFUSABLE),
        (NAME - 1.0, -5.0, 0.0, Verdict.NONE),
        (NAME - 1.0, -5.0, 9.0, Verdict.UNKNOWN),
    ],
)
def test_the_verdict_follows_from_the_gains(
    gain: float, second: float, model_error: float, verdict: Verdict
) -> None:
    laws = law("grousers", gain), law("exit_angle", second)
    assert judge(weighed(*laws, model_error=model_error), {}).verdict is verdict


def test_prior_odds_move_a_name_by_their_logarithm() -> None:
    fitted = weighed(law("grousers", NAME - 1.0), law("exit_angle", -5.0))
    assert judge(fitted, {}).verdict is Verdict.NONE
    likelier = judge(fitted, {"grousers": 10.0})
    assert likelier.verdict is Verdict.NAMED
    before, after = judge(fitted, {}).probabilities, likelier.probabilities
    odds = [each["grousers"] / (each["none"] + each["unknown"]) for each in (before, after)]
    assert odds[1] == pytest.approx(10.0 * odds[0])
