# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil constants that differ from those of the soil file, found from the runs.

A soil file that is wrong looks like a missing effect. So the constants compete with the effects:
one fit says which constants the runs have in common, and a study on these is judged by its evidence
like any other explanation, less the price of the constants.
"""

import dataclasses
import math
from dataclasses import dataclass

from torch import Tensor

from rover_parameters.records import ConfigError, build
from terrain_estimator.discovery.evidence.common_constants import (
    COMMON_SD,
    changed_constants,
    fit_together,
    relative_change,
)
from terrain_estimator.discovery.evidence.soil_starts import best_start
from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.hypotheses.unknowns import Point
from terramechanics.terrain.soil import CONSTANTS, WONG_REECE, Soil

LARGEST_PLACE = 1.1 * 0.43
"""[1] Largest c1 that is fitted, where the file has no larger one.

It is the largest one published, of compact sand (Wong and Reece 1967), and a tenth for sites. A
force ahead of the wheels, such as that of soil which they push, looks like a larger one.
"""


@dataclass(frozen=True, slots=True)
class Revision:
    """The constants of one soil file that the runs contradict."""

    told: Soil
    found: Soil
    runs: int
    sd: dict[str, float]  # standard deviation of each uncertain constant, in its own unit
    of_file: bool = False  # whether the constants found are those of another soil file

    @property
    def moved(self) -> tuple[str, ...]:
        """The constants that are more than two deviations off: none where the own file fits."""
        return tuple(
            name
            for name, sd in self.sd.items()
            if abs(getattr(self.found, name) - getattr(self.told, name)) > 2.0 * sd
        )

    @property
    def is_new(self) -> bool:
        """Whether no soil file at hand has the constants found."""
        return bool(self.moved) and not self.of_file


@dataclass(frozen=True, slots=True)
class RevisedStudy:
    """Runs on the soils that fit them."""

    study: Study
    revisions: tuple[Revision, ...]
    price: float  # [nat] of the constants that were fitted to the runs
    beside: Candidate  # the hypothesis beside which they were fitted; nothing where they were not

    @property
    def of_files(self) -> bool:
        """Whether all these soils have files, and no constant was fitted."""
        return all(each.of_file for each in self.revisions)

    def gain(self, candidate: Candidate, told: Study) -> float:
        """Return the gain [nat] of a candidate here over nothing on the soils as told."""
        return candidate.fit.log_evidence - self.price - told.nothing.fit.log_evidence


def revised(told: Study, start: Candidate, at: Study | None = None) -> RevisedStudy | None:
    """Return the study on the constants that the runs have in common beside a hypothesis.

    ``told`` is on the soil files; ``start`` is a fit of the hypothesis to the runs on the soils of
    ``at``, by default those of the files. None where the constants that fit are none of a soil, or
    the stress is largest where no soil is known to have it. Changes are factors: None, too, where a
    constant of ``at`` is zero or has another sign than that told.
    """
    hypothesis = start.hypothesis
    if at is not None and not _is_within_reach(told, at):
        return None
    together = fit_together(told, hypothesis, start.fit.point, (at or told).nominal)
    effects = len(hypothesis.shared().step)
    values, changes = together.point.shared[:effects], together.point.shared[effects:]
    try:
        soils = _changed(told, changes)
    except ConfigError:
        return None
    if not all(_is_known(*each) for each in soils.items()):
        return None
    nominal = dataclasses.replace(told.nominal, revised=tuple(soils.items()))
    return _on(told, hypothesis, nominal, together.point.with_shared(values))


def revised_alone(told: Study, enough: float) -> RevisedStudy | None:
    """Return the study on the constants that explain the runs best with nothing else missing.

    They are searched from the soil files, and from other soils, too, where those found from the
    files explain less than ``enough`` [nat]. None as in :func:`revised`.
    """
    near = revised(told, told.nothing)
    if near is not None and near.gain(near.beside, told) >= enough:
        return near
    start = best_start(told)
    at = _on(told, told.none, start.nominal, start.point)
    fitted = [each for each in (near, revised(told, at.beside, at.study)) if each is not None]
    # a start alone is coarse: the constants that fit better are then none of a soil
    tried = [*fitted, at] if fitted else []
    return max(tried, key=lambda each: each.gain(each.beside, told), default=None)


def _on(told: Study, hypothesis: Hypothesis, nominal: Nominal, point: Point) -> RevisedStudy:
    """Return the study on the soils of ``nominal``, from a point near the fit of a hypothesis."""
    nothing = point.with_shared(point.shared[: len(hypothesis.doubt)])
    there = Study(nominal, told.runs, told.mask, told.contributions, nothing)
    beside = there.fit_from(hypothesis, point) if hypothesis.effects else there.nothing
    return RevisedStudy(there, *_revisions(there, told.nominal), beside)


def _changed(study: Study, changes: Tensor) -> dict[Soil, Soil]:
    """Return the soils whose constants have changed by ``changes`` [S M], by the soils as told.

    Raises ConfigError where a soil cannot have such constants.
    """
    soils, found = list(dict.fromkeys(study.soils)), {}
    for told, change in zip(soils, changes.view(len(soils), -1), strict=True):
        found[told] = _soil(told, changed_constants(study.nominal, told, change))
    return found


def _is_within_reach(told: Study, at: Study) -> bool:
    """Return whether changes of the constants as told lead to the soils of another study."""
    return all(
        bool(relative_change(told.nominal, soil, at.nominal.soil_of(soil)).isfinite().all())
        for soil in told.soils
    )


def _is_known(told: Soil, found: Soil) -> bool:
    """Return whether the largest stress is where some soil is known to have it."""
    return found.law != WONG_REECE or found.c1 <= max(LARGEST_PLACE, told.c1)


def _soil(told: Soil, constants: Tensor) -> Soil:
    found = dict(zip(CONSTANTS, constants.tolist(), strict=True))
    content = dataclasses.asdict(told) | found | {"name": f"{told.name}_found"}
    return build(Soil, content, f"soil {told.name}, constants that fit")


def _revisions(study: Study, told: Nominal) -> tuple[tuple[Revision, ...], float]:
    """Return what was found of each soil, and its price [nat].

    The price is the logarithm of prior over posterior of the constants in common, by Laplace. They
    are the means over runs whose own constants scatter by the prior as told.
    """
    revisions, price = [], 0.0
    for soil, found in study.nominal.revised:
        count = sum((run.soil or told.soil) == soil for run in study.runs)
        relative = told.prior.constants_sd / math.sqrt(count)
        uncertain = nominal_of(told.rover, soil, told.prior).uncertain
        scale = uncertain.sum(0) / told.prior.constants_sd  # [6] the constants as told
        free = scale > 0.0
        price += int(free.sum()) * math.log(COMMON_SD / relative)
        change = relative_change(told, soil, found)
        price += 0.5 * float((change / COMMON_SD).square().sum())
        sd = {
            name: relative * float(size)
            for name, size, is_free in zip(CONSTANTS, scale, free, strict=True)
            if is_free
        }
        revisions.append(Revision(soil, found, count, sd))
    return tuple(revisions), price
