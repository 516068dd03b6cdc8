# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Constants from which to search where those of a soil file are far from the ground.

Where the ground is many times as stiff as the file says, a search from the file's constants stops
at once: no small change of them makes the wheels carry the rover. So some soils from soft to firm
are tried, each as stiff as the measured sinkages need, and the best is where the search begins.
"""

import dataclasses
from itertools import product

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.fit import Fit, fit
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Point
from terramechanics.contact.laws import contact_law
from terramechanics.contact.stresses import quadrature
from terramechanics.terrain.soil import WONG_REECE, Soil

EXPONENTS = (0.5, 0.8, 1.1)
"""[1] Exponents n to try: firm soils to dry sand (Wong, Theory of Ground Vehicles, table 2.3)."""
PLACES = (0.2, 0.4)
"""[1] Places c1 of the largest stress to try, by the law of Wong and Reece."""
STEPS = 3
"""Steps in which the runs' own unknowns are fitted at each."""
LEAST_LOAD = 0.1
"""[1] Share of a wheel's load that is left to the stiffness, however much cohesion carries."""


@dataclasses.dataclass(frozen=True, slots=True)
class Start:
    """Soils, and the runs' own unknowns that fit them with nothing missing."""

    nominal: Nominal
    point: Point


def best_start(study: Study) -> Start:
    """Return for each soil of a study the start at which its runs are missed least.

    One of them is the soil as the study has it.
    """
    tried = [(study.nominal, study.nothing.fit)]
    tried += [(at, _fitted(study, at)) for at in _starts(study)]
    best = {
        soil: min(tried, key=lambda each: _misfit(study, soil, each[1])) for soil in study.soils
    }
    revised = tuple((soil, at.soil_of(soil)) for soil, (at, _) in best.items())
    runs = tuple(best[soil][1].point.runs[k] for k, soil in enumerate(study.soils))
    nominal = dataclasses.replace(study.nominal, revised=revised)
    return Start(nominal, dataclasses.replace(study.nothing.fit.point, runs=runs))


def _misfit(study: Study, soil: Soil, found: Fit) -> float:
    """Return the misfit of the runs on a soil."""
    each = zip(study.soils, found.equations, strict=True)
    return sum(equations.misfit for own, equations in each if own == soil)


def _fitted(study: Study, at: Nominal) -> Fit:
    """Return the fit of the runs' own unknowns on other soils, from the prior's mean."""
    unknown: list[Tensor | None] = [None] * len(study.runs)
    evaluate, columns = study.evaluate(study.none, at), study.no_columns
    return fit(evaluate, study.prior_mean(), study.none.shared(), columns, unknown, most=STEPS)


def _starts(study: Study) -> list[Nominal]:
    """Return the study's nominal model on each of the soils to try."""
    told = dict.fromkeys(study.soils)
    return [
        dataclasses.replace(
            study.nominal,
            revised=tuple((soil, _carrying(study, soil, n, c1)) for soil in told),
        )
        for n, c1 in product(EXPONENTS, PLACES)
    ]


def _carrying(study: Study, told: Soil, n: float, c1: float) -> Soil:
    """Return a soil with these constants on which the wheels carry the rover.

    Its stiffness is such that at the sinkages of the runs on ``told`` the median wheel carries its
    share of the weight.
    """
    soil = told.with_values(n=n, c1=c1 if told.law == WONG_REECE else told.c1)
    rover, strength = study.nominal.rover, soil.strength()
    runs = [run for run, own in zip(study.runs, study.soils, strict=True) if own == told]
    slip, sinkage = (
        torch.cat([getattr(run.signals, name).flatten() for run in runs])
        for name in ("slip", "sinkage")
    )
    rows = contact_law(soil.law)(
        slip,
        sinkage,
        soil.constants(),
        rover.wheel_radius,
        rover.wheel_width,
        quadrature(),
    )[:, 0]
    weight = rover.mass * rover.gravity / (rover.axles * rover.wheels_per_axle)
    by_stiffness = rows[:, 1] * strength[1] + rows[:, 2]
    left = (weight - rows[:, 0] * strength[0]).clamp(min=LEAST_LOAD * weight)
    factor = float((left / by_stiffness).median())
    return soil.with_values(k_c=factor * soil.k_c, k_phi=factor * soil.k_phi)
