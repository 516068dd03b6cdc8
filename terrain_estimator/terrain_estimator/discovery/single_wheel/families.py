# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One rule from the evidence of laws to a name for the tables of one wheel.

A name is a family: the laws that authors give for one effect, or for two that act together. Every
law is fitted with a model error beside it (:mod:`model_error`), so that it has to gain over an
error without a name, not over a contact law that nobody believes to the last newton. The laws of a
family share its prior odds equally, so that more laws in one family do not change the odds between
families::

    E(family) = log mean exp E(law)

1. A family is likelier than no name where E, with the log odds that a user states, gains NAME over
   the model error alone.
2. Families within APART of the best are as good an explanation: a confusable set.
3. Without a name something is missing where the model error gains UNNAMED over none.

The three steps are smooth in the probabilities, and the verdict is that of the most probable
answer. NAME is calibrated by ``studies.false_names``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import logsumexp

from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.single_wheel.fit import Explained

NAME = 4.0
"""[nat] Least gain of a family over the model error."""
UNNAMED = 3.0
"""[nat] Least gain of the model error over none: odds of twenty to one."""
APART = 3.0
"""[nat] Gain by which a family is told from another one: odds of twenty to one."""


@dataclass(frozen=True, slots=True)
class Family:
    """The laws of one name."""

    laws: tuple[Explained, ...]  # the most probable first

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return self.laws[0].hypothesis.names

    @property
    def log_evidence(self) -> float:
        """Evidence with the prior odds split equally among the laws [nat]."""
        every = [each.log_evidence for each in self.laws]
        return float(logsumexp(every)) - math.log(len(every))

    @property
    def weights(self) -> tuple[float, ...]:
        """Probability of each law within the family."""
        every = [each.log_evidence for each in self.laws]
        return tuple(math.exp(each - float(logsumexp(every))) for each in every)


def families(fitted: Sequence[Explained]) -> list[Family]:
    """Return the families of some laws, the most probable first."""
    by_name: dict[tuple[str, ...], list[Explained]] = {}
    for each in sorted(fitted, key=lambda each: -each.log_evidence):
        by_name.setdefault(each.hypothesis.names, []).append(each)
    found = [Family(tuple(each)) for each in by_name.values()]
    return sorted(found, key=lambda each: -each.log_evidence)


@dataclass(frozen=True, slots=True)
class Weighed:
    """Families and the two fits without a name."""

    nothing: float  # log evidence of the contact law alone [nat]
    nothing_with: float  # with the model error
    families: tuple[Family, ...]  # the most probable first, without prior odds

    def gain(self, family: Family, odds: Mapping[str, float]) -> float:
        """Return the log odds of a family over no name [nat], prior ``odds`` of names included."""
        prior = sum(math.log(odds.get(name, 1.0)) for name in family.names)
        return family.log_evidence - max(self.nothing, self.nothing_with) + prior


def judge(weighed: Weighed, odds: Mapping[str, float]) -> Judgement:
    """Apply the rule; ``odds`` are prior odds of names over what is usual."""
    gains = {each.names: weighed.gain(each, odds) for each in weighed.families}
    unnamed = weighed.nothing_with - weighed.nothing - UNNAMED
    total = float(logsumexp([0.0, *(gain - NAME for gain in gains.values())]))
    without = math.exp(-total)
    unknown = without / (1.0 + math.exp(-max(-50.0, min(50.0, unnamed))))
    probabilities = {"none": without - unknown, "unknown": unknown} | {
        " + ".join(names): math.exp(gain - NAME - total) for names, gain in gains.items()
    }
    best = max(gains.values())
    alike = [each for each in weighed.families if gains[each.names] >= best - APART]
    alike.sort(key=lambda each: -gains[each.names])
    named = tuple(_first_law(each) for each in alike)
    if without < 0.5:
        verdict = Verdict.NAMED if len(named) == 1 else Verdict.CONFUSABLE
    elif unknown > 0.5 * without:
        verdict, named = Verdict.UNKNOWN, named[:1]
    else:
        verdict, named = Verdict.NONE, ()
    return Judgement(verdict, named, probabilities)


def _first_law(family: Family) -> Hypothesis:
    return family.laws[0].hypothesis
