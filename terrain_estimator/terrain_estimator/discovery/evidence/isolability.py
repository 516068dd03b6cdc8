# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects that some runs can separate.

Where effect i is missing at a typical size, its signature is the change of the rows. Effect j
explains a part of it, with its size in its physical range and its extra values free, and the runs'
own unknowns explain another. The rest is the expected log Bayes factor of i over j, and with
nothing in place of j the one of i over "nothing is missing" (``expected``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial, reduce

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.expected import Stage, loss, stage
from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.hypotheses.doubted_rows import rows_of
from terrain_estimator.discovery.hypotheses.equations import RunEquations
from terrain_estimator.discovery.hypotheses.library import NOT_BY_WHEEL, NOTHING, Hypothesis
from terrain_estimator.discovery.hypotheses.rover_doubt import CERTAIN
from terrain_estimator.discovery.hypotheses.rows import Expansion, Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.runs import Blocks
from terramechanics.effects import EFFECTS

LEAST = 3.0
"""[nat] Expected log Bayes factor over nothing below which runs do not excite an effect."""


@dataclass(frozen=True, slots=True)
class Signature:
    """The change that a hypothesis makes to the rows of some runs."""

    # [B, Q, 1 + F] at the typical size, then further changes by a deviation of each extra value
    runs: tuple[Tensor, ...]
    ends: tuple[float, float]  # [1] physical range of the size, in units of the typical one

    def joined(self, other: "Signature") -> "Signature":
        """Return the signature in more runs."""
        return Signature(self.runs + other.runs, self.ends)


@dataclass(frozen=True, slots=True)
class Isolability:
    """Expected separation of the effects that the runs excite."""

    names: tuple[str, ...]
    # [n, n] expected log Bayes factor of a row's effect over a column's; diagonal: over nothing
    nats: Tensor
    not_testable: dict[str, str]  # why, by name

    def nearest(self, name: str) -> str | None:
        """Return the effect that explains ``name`` best; None where there is none."""
        if name not in self.names or len(self.names) == 1:
            return None
        row = self.nats[self.names.index(name)].clone()
        row[self.names.index(name)] = torch.inf
        return self.names[int(row.argmin())]


def isolability(study: Study, hypotheses: Sequence[Hypothesis], around: Candidate) -> Isolability:
    """Return the isolability of effects in the runs of ``study``.

    Ground and unexplained noise are those of the candidate ``around``.
    """
    stages, found = stages_of(around), signatures(study, hypotheses, around)
    names = [each.label for each in hypotheses]
    nats = matrix(stages, found)
    excited = [k for k in range(len(names)) if float(nats[k, k]) >= LEAST]
    why = (
        {
            name: "it acts sideways, which a planar rover does not show"
            for name, each in EFFECTS.items()
            if not each.planar
        }
        if study.nominal.places is None
        else dict(NOT_BY_WHEEL)
    )
    for k, name in enumerate(names):
        if k not in excited:
            gain = max(float(nats[k, k]), 0.0)
            why[name] = (
                "these runs do not excite it: at a typical size it is expected to gain"
                f" {gain:.1g} nat"
            )
    return Isolability(tuple(names[k] for k in excited), nats[excited][:, excited], why)


def matrix(stages: Sequence[Stage], found: Sequence[Signature]) -> Tensor:
    """Return expected log Bayes factors [nat] of every signature over every other.

    On the diagonal over nothing.
    """
    nats = torch.zeros(len(found), len(found), dtype=torch.float64)
    for i, true in enumerate(found):
        others = [other for j, other in enumerate(found) if j != i]
        alone = loss(stages, table(true, others), None)
        nats[i] = alone.nats
        first = 1
        for j, other in enumerate(found):
            if j == i:
                continue
            size = other.runs[0].shape[2]
            if _promise(alone.gram, slice(first, first + size)) > _PROMISING * alone.nats:
                nats[i, j] = min(
                    loss(stages, table(true, [other]), other.ends, alone.excess).nats, alone.nats
                )
            first += size
    return nats


def between(stages: Sequence[Stage], true: Signature, other: Signature) -> float:
    """Return the expected log Bayes factor [nat] of the ``true`` signature over another one."""
    return loss(stages, table(true, [other]), other.ends).nats


_PROMISING = 0.01
"""[1] Share that a first step of another effect has to explain to be looked at."""


def table(true: Signature, others: Sequence[Signature]) -> list[Tensor]:
    """Return a signature and the columns of others, [B, Q, 1 + K] of each run.

    As :func:`expected.loss` takes them.
    """
    return [
        torch.cat([mine[..., :1], *rest], 2)
        for mine, *rest in zip(true.runs, *(other.runs for other in others), strict=True)
    ]


def _promise(gram: Tensor, columns: slice) -> float:
    """Return the share of the signature [nat] that these columns explain in one step."""
    pull, block = gram[columns, 0], gram[columns, columns]
    return 0.5 * float(pull @ torch.linalg.solve(block + torch.diag(1e-9 + 0.0 * pull), pull))


def stages_of(around: Candidate) -> list[Stage]:
    """Return the linearised rows of all runs under a candidate."""
    doubted, runs = len(around.hypothesis.doubt), len(around.fit.equations)
    return [
        stage(each, unknowns, each.excess, doubted, runs)
        for each, unknowns in zip(around.fit.equations, around.fit.point.runs, strict=True)
    ]


def signatures(
    study: Study, hypotheses: Sequence[Hypothesis], around: Candidate
) -> list[Signature]:
    """Return the signatures of hypotheses in all runs."""
    of_run = partial(
        _signatures_there,
        nominal=study.nominal,
        mask=study.mask,
        hypotheses=tuple(hypotheses),
    )
    every = study.contributions(
        of_run,
        [
            (own, each.around)
            for own, each in zip(around.fit.point.runs, around.fit.equations, strict=True)
        ],
    )
    return [reduce(Signature.joined, each) for each in zip(*every, strict=True)]


def _signatures_there(
    run: Blocks,
    where: tuple[Unknowns, Expansion],
    *,
    nominal: Nominal,
    mask: Tensor,
    hypotheses: Sequence[Hypothesis],
) -> list[Signature]:
    return run_signatures(nominal, run, mask, hypotheses, *where)


@torch.inference_mode()
def run_signatures(
    nominal: Nominal,
    run: Blocks,
    mask: Tensor,
    hypotheses: Sequence[Hypothesis],
    unknowns: Unknowns,
    around: Expansion,
) -> list[Signature]:
    """Return the signatures of hypotheses in one run, with the rows expanded ``around``."""

    def rows(hypothesis: Hypothesis, values: tuple[float, ...]) -> Tensor:
        return RunEquations(run, rows_of(nominal, run, hypothesis), mask).shortfall(
            unknowns, values, around
        )

    nothing = rows(NOTHING, ())
    found = []
    for each in hypotheses:
        hypothesis = each.doubting(CERTAIN)  # the constants are unknowns of every stage
        values, shared = hypothesis.typical(), hypothesis.shared()
        changes = [nothing - rows(hypothesis, values)]
        for k in range(1, len(values)):
            moved = tuple(value + float(shared.sd[k]) * (n == k) for n, value in enumerate(values))
            changes.append(nothing - rows(hypothesis, moved) - changes[0])
        found.append(
            Signature(
                (torch.stack(changes, -1),),
                (float(shared.low[0]) / values[0], float(shared.high[0]) / values[0]),
            )
        )
    return found
