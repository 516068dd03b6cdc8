# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil constants that differ from those of the soil file, found from the runs.

A soil file that is wrong looks like a missing effect. So the constants compete with the effects:
fits with a wide prior say which constants the runs have in common, and a study on these is judged
by its evidence like any other explanation, less the price of the constants.
"""

import dataclasses
import math
from dataclasses import dataclass

import torch
from torch import Tensor

from rover_parameters.records import ConfigError, build
from terrain_estimator.discovery.evidence.search import Candidate, Study
from terrain_estimator.discovery.hypotheses.library import NOTHING, Hypothesis
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terramechanics.terrain.soil import CONSTANTS, Soil

STEP_SD = 0.2
"""[1] Relative prior deviation of the constants of each run while common ones are searched."""
COMMON_SD = 0.5
"""[1] Relative prior deviation of the constants that the runs of a soil have in common."""
ROUNDS = 2
"""Fits, each around the constants that the one before has found."""


@dataclass(frozen=True, slots=True)
class Revision:
    """The constants of one soil file that the runs contradict."""

    told: Soil
    found: Soil
    runs: int
    sd: dict[str, float]  # standard deviation of each uncertain constant, in its own unit

    @property
    def moved(self) -> tuple[str, ...]:
        """The constants that are more than two deviations off: none where the own file fits."""
        return tuple(
            name
            for name, sd in self.sd.items()
            if abs(getattr(self.found, name) - getattr(self.told, name)) > 2.0 * sd
        )


@dataclass(frozen=True, slots=True)
class RevisedStudy:
    """Runs on the soils that fit them."""

    study: Study
    revisions: tuple[Revision, ...]
    price: float  # [nat] of the constants that were fitted to the runs

    def gain(self, candidate: Candidate, told: Study) -> float:
        """Return the gain [nat] of a candidate here over nothing on the soils as told."""
        return candidate.fit.log_evidence - self.price - told.nothing.fit.log_evidence


def revised(study: Study, told: Nominal, hypothesis: Hypothesis = NOTHING) -> RevisedStudy | None:
    """Return the study on the constants that the runs have in common under a hypothesis.

    ``told`` is the nominal model with the soil files; ``study`` may be on revised soils already.
    None where the constants that fit are none of a soil.
    """
    here = study
    for _ in range(ROUNDS):
        wide = _with_prior(here.nominal, STEP_SD)
        there = Study(wide, here.runs, here.mask, here.contributions)
        found = there.explain(hypothesis) if hypothesis.effects else there.nothing
        try:
            soils = _common(there, found)
        except ConfigError:
            return None
        nominal = dataclasses.replace(told, revised=tuple(soils.items()))
        here = Study(nominal, here.runs, here.mask, here.contributions)
    return RevisedStudy(here, *_revisions(here, told))


def _with_prior(nominal: Nominal, constants_sd: float) -> Nominal:
    prior = dataclasses.replace(nominal.prior, constants_sd=constants_sd)
    wide = nominal_of(nominal.rover, nominal.soil, prior)
    return dataclasses.replace(wide, revised=nominal.revised)


def _common(study: Study, found: Candidate) -> dict[Soil, Soil]:
    """Return the soils with the mean constants of their runs, by the soils as told.

    Raises ConfigError where a soil cannot have such constants.
    """
    values: dict[Soil, list[Tensor]] = {}
    for run, own in zip(study.runs, found.fit.point.runs, strict=True):
        ground = study.nominal.of(run)
        constants = ground.contact.constants + own.kappa @ ground.uncertain
        values.setdefault(run.soil or study.nominal.soil, []).append(constants)
    return {told: _soil(told, torch.stack(each).mean(0)) for told, each in values.items()}


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
        shift = (found.constants() - soil.constants()) / scale.clamp(min=1e-300)
        free = scale > 0.0
        price += int(free.sum()) * math.log(COMMON_SD / relative)
        price += 0.5 * float((shift[free] / COMMON_SD).square().sum())
        sd = {
            name: relative * float(size)
            for name, size, is_free in zip(CONSTANTS, scale, free, strict=True)
            if is_free
        }
        revisions.append(Revision(soil, found, count, sd))
    return tuple(revisions), price
