# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One fit of a hypothesis and of the soil constants that all runs of a soil have in common.

The constants of a run are those of the soil file, a change that the runs of the soil share, and the
run's own scatter as everywhere. So the columns of the change are the sums of the columns of the
runs' own constants, and a step costs no more than one of the runs' own constants alone.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.fit import Evaluate, Fit, fit
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.equations import Equations, Query
from terrain_estimator.discovery.hypotheses.library import Hypothesis, Shared
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.hypotheses.unknowns import Point
from terrain_estimator.model.physics import UNCERTAIN
from terramechanics.terrain.soil import Soil

COMMON_SD = 0.5
"""[1] Relative prior deviation of the constants that the runs of a soil have in common."""
LEAST_EXPONENT = 0.2
"""[1] Least exponent n, over that told."""
LONGEST, LONGEST_STIFFNESS = 0.4, 1.6
"""[1] Largest change in one step, and that of k_phi: a small change of n goes with a large one."""
STEPS = 10
"""Steps of the search at most."""
DARING = 6
"""Of these the first ones, which are made even where they fit worse.

Constants make up for each other along bent valleys: a step along one leaves the floor, to which the
next step comes back. By steps that must each fit better the search does not get far.
"""


@dataclass(frozen=True, slots=True)
class WithCommonConstants:
    """Equations of all runs whose last shared unknowns are changes of the constants in common.

    There are M for each of S soils, relative to the constants as told: the change of n itself and
    logarithms of factors of the others, so that these keep their sign and a stiffness may change
    many times over. The pressure k z^n then has a straight valley, along which k makes up for n.
    """

    evaluate: Evaluate  # at constants that have the changes ``reached``
    places: tuple[int, ...]  # of each run's soil among the S
    reached: Tensor  # [S M]
    sd: float  # [1] relative prior deviation of a run's own constants, their unit

    def __call__(self, queries: Sequence[Query]) -> list[Equations]:
        """Return the equations of every run at constants that are changed."""
        changes = [self._changes(each, k) for each, k in zip(queries, self.places, strict=True)]
        constants = _factors(self.reached.view(-1, changes[0].shape[0]))
        found = self.evaluate(
            [
                self._moved(query, _factors(to) / constants[place])
                for query, to, place in zip(queries, changes, self.places, strict=True)
            ]
        )
        return [
            self._extended(each, place, _slopes(to) / constants[place])
            for each, to, place in zip(found, changes, self.places, strict=True)
        ]

    def _changes(self, query: Query, place: int) -> Tensor:
        """Return the changes [M] of a run's soil."""
        each = torch.tensor(query.sizes[-self.reached.shape[0] :], dtype=torch.float64)
        return each.view(-1, query.unknowns.kappa.shape[0])[place]

    def _moved(self, query: Query, factors: Tensor) -> Query:
        """Return the query without the changes, at constants times ``factors`` [M]."""
        unknowns, count = query.unknowns, self.reached.shape[0]
        kappa = unknowns.kappa + (factors - 1.0) / self.sd
        return dataclasses.replace(
            query,
            unknowns=dataclasses.replace(unknowns, kappa=kappa),
            sizes=query.sizes[:-count],
            steps=query.steps[:-count],
        )

    def _extended(self, equations: Equations, place: int, slopes: Tensor) -> Equations:
        """Return the equations with the changes as last unknowns: they move what a run's own do."""
        constants, count = slopes.shape[0], self.reached.shape[0]
        own = slice(2, 2 + constants)
        moved = torch.zeros(equations.hessian.shape[0], count, dtype=torch.float64)
        moved[own, place * constants : (place + 1) * constants] = torch.diag(slopes / self.sd)
        both = torch.cat([torch.eye(moved.shape[0], dtype=torch.float64), moved], 1)
        return dataclasses.replace(
            equations,
            hessian=both.T @ equations.hessian @ both,
            gradient=both.T @ equations.gradient,
            jacobian=torch.cat([equations.jacobian, equations.by_constant @ moved[own]], -1),
        )


def _is(name: str, changes: Tensor) -> Tensor:
    """Return which of the changes [..., M] is that of a constant, [M] bool."""
    return torch.arange(changes.shape[-1]) == UNCERTAIN.index(name)


def _factors(changes: Tensor) -> Tensor:
    """Return the factors [..., M] of the constants as told."""
    return torch.where(_is("n", changes), 1.0 + changes, torch.exp(changes))


def _slopes(changes: Tensor) -> Tensor:
    """Return the derivatives [..., M] of the factors by the changes."""
    return torch.where(_is("n", changes), 1.0, torch.exp(changes))


def fit_together(study: Study, hypothesis: Hypothesis, start: Point, at: Nominal) -> Fit:
    """Fit a hypothesis and the changes of the constants of every soil that ``study`` has.

    Begin at ``start`` on the soils of ``at``. Of these the runs' own constants are a share. The
    shared unknowns of the result are those of the hypothesis, then the changes as
    WithCommonConstants has them.
    """
    soils, told = study.soils, list(dict.fromkeys(study.soils))
    changes = [relative_change(study.nominal, soil, at.soil_of(soil)) for soil in told]
    reached, sd = torch.cat(changes), study.nominal.prior.constants_sd
    return fit(
        WithCommonConstants(
            study.evaluate(hypothesis, at), tuple(map(told.index, soils)), reached, sd
        ),
        start.with_shared(torch.cat([start.shared, reached])),
        _shared(hypothesis.shared(), changes),
        study.no_columns,
        [None] * len(soils),
        most=STEPS,
        daring=DARING,
    )


def _shared(sizes: Shared, changes: Sequence[Tensor]) -> Shared:
    """Return the sizes of effects and the changes of the constants as shared unknowns."""
    exponent = torch.cat([_is("n", each) for each in changes])
    stiffness = torch.cat([_is("k_phi", each) for each in changes])
    free = torch.full_like(torch.cat(list(changes)), torch.inf)
    longest = torch.where(stiffness, LONGEST_STIFFNESS, LONGEST)
    return Shared(
        torch.cat([sizes.low, torch.where(exponent, LEAST_EXPONENT - 1.0, -free)]),
        torch.cat([sizes.high, free]),
        torch.cat([sizes.sd, torch.full_like(free, COMMON_SD)]),
        (*sizes.step, *[0.0] * len(free)),
        torch.cat([torch.full_like(sizes.low, torch.inf), longest]),
    )


def relative_change(told: Nominal, soil: Soil, found: Soil) -> Tensor:
    """Return the change [M] of a soil's constants to those of ``found``.

    As WithCommonConstants has it.
    """
    before, after = (nominal_of(told.rover, each, told.prior) for each in (soil, found))
    kappa = torch.linalg.lstsq(
        before.uncertain.T, (after.contact.constants - before.contact.constants).unsqueeze(1)
    ).solution.squeeze(1)
    factors = 1.0 + kappa * told.prior.constants_sd
    return torch.where(_is("n", factors), factors - 1.0, torch.log(factors))


def changed_constants(told: Nominal, soil: Soil, change: Tensor) -> Tensor:
    """Return the constants [6] of a soil whose uncertain ones have changed by ``change`` [M]."""
    ground = nominal_of(told.rover, soil, told.prior)
    kappa = (_factors(change) - 1.0) / told.prior.constants_sd
    return ground.contact.constants + kappa @ ground.uncertain
