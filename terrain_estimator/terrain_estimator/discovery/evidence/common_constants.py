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
from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.hypotheses.equations import Equations, Query
from terrain_estimator.discovery.hypotheses.library import Shared
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.leftover.flexible import no_columns
from terramechanics.terrain.soil import Soil

COMMON_SD = 0.5
"""[1] Relative prior deviation of the constants that the runs of a soil have in common."""
LONGEST = 0.4
"""[1] Largest change of the logarithm of a constant in one step."""
STEPS = 10
"""Steps of the search at most."""
DARING = 6
"""Of these the first ones, which are made even where they fit worse.

Constants make up for each other along a bent valley: a step along it leaves the floor, to which the
next one comes back. By steps that must each fit better the search does not get far.
"""


@dataclass(frozen=True, slots=True)
class WithCommonConstants:
    """Equations of all runs whose last shared unknowns are changes of the constants in common.

    They are logarithms of factors, M for each of S soils, so that no constant changes its sign and
    a stiffness may change many times over.
    """

    evaluate: Evaluate  # without the changes
    places: tuple[int, ...]  # of each run's soil among the S
    count: int  # S M
    sd: float  # [1] relative prior deviation of a run's own constants, their unit

    def __call__(self, queries: Sequence[Query]) -> list[Equations]:
        """Return the equations of every run at constants that are changed."""
        logs = [self._logs(query, place) for query, place in zip(queries, self.places, strict=True)]
        found = self.evaluate(
            [self._changed(query, log) for query, log in zip(queries, logs, strict=True)]
        )
        return [
            self._extended(each, place, log)
            for each, place, log in zip(found, self.places, logs, strict=True)
        ]

    def _logs(self, query: Query, place: int) -> Tensor:
        """Return the changes [M] of a run's soil."""
        each = torch.tensor(query.sizes[-self.count :], dtype=torch.float64)
        return each.view(-1, query.unknowns.kappa.shape[0])[place]

    def _changed(self, query: Query, logs: Tensor) -> Query:
        """Return the query without the changes, at constants that have them."""
        unknowns = query.unknowns
        kappa = unknowns.kappa + torch.expm1(logs) / self.sd
        return dataclasses.replace(
            query,
            unknowns=dataclasses.replace(unknowns, kappa=kappa),
            sizes=query.sizes[: -self.count],
            steps=query.steps[: -self.count],
        )

    def _extended(self, equations: Equations, place: int, logs: Tensor) -> Equations:
        """Return the equations with the changes as last unknowns: they move what a run's own do."""
        constants = logs.shape[0]
        own = slice(2, 2 + constants)
        moved = torch.zeros(equations.hessian.shape[0], self.count, dtype=torch.float64)
        moved[own, place * constants : (place + 1) * constants] = torch.diag(logs.exp() / self.sd)
        both = torch.cat([torch.eye(moved.shape[0], dtype=torch.float64), moved], 1)
        return dataclasses.replace(
            equations,
            hessian=both.T @ equations.hessian @ both,
            gradient=both.T @ equations.gradient,
            jacobian=torch.cat([equations.jacobian, equations.by_constant @ moved[own]], -1),
        )


def fit_together(study: Study, start: Candidate, at: Nominal) -> Fit:
    """Fit a hypothesis and the changes of the constants of every soil that ``study`` has.

    Begin at ``start``, which was fitted to the runs on the soils of ``at``. The shared unknowns of
    the result are those of the hypothesis, then the changes as WithCommonConstants has them.
    """
    soils, sizes = study.soils, start.hypothesis.shared()
    told, sd = list(dict.fromkeys(soils)), study.nominal.prior.constants_sd
    changes = torch.cat([_change(study.nominal, at, soil) for soil in told])
    one = torch.ones_like(changes)
    shared = Shared(
        torch.cat([sizes.low, -torch.inf * one]),
        torch.cat([sizes.high, torch.inf * one]),
        torch.cat([sizes.sd, COMMON_SD * one]),
        (*sizes.step, *[0.0] * len(changes)),
        torch.cat([torch.full_like(sizes.low, torch.inf), LONGEST * one]),
    )
    places = tuple(map(told.index, soils))
    return fit(
        WithCommonConstants(study.evaluate(start.hypothesis), places, len(changes), sd),
        start.fit.point.with_shared(torch.cat([start.fit.point.shared, changes])),
        shared,
        no_columns(study.runs).columns,
        [None] * len(soils),
        most=STEPS,
        daring=DARING,
    )


def _change(told: Nominal, at: Nominal, soil: Soil) -> Tensor:
    """Return the change [M] of a soil's constants from those told to those of ``at``."""
    before, after = (nominal_of(told.rover, each, told.prior) for each in (soil, at.soil_of(soil)))
    kappa = torch.linalg.lstsq(
        before.uncertain.T, (after.contact.constants - before.contact.constants).unsqueeze(1)
    ).solution.squeeze(1)
    return torch.log1p(kappa * told.prior.constants_sd)


def changed_constants(told: Nominal, soil: Soil, change: Tensor) -> Tensor:
    """Return the constants [6] of a soil whose uncertain ones have changed by ``change`` [M]."""
    ground = nominal_of(told.rover, soil, told.prior)
    kappa = torch.expm1(change) / told.prior.constants_sd
    return ground.contact.constants + kappa @ ground.uncertain
