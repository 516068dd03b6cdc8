# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Runs on another soil than they were told to be on, of those whose files are at hand.

Whoever tells the wrong soil often has the file of the right one. To take that file costs the runs
nothing: no constant is fitted, so that none takes up a part of a missing effect.
"""

import dataclasses
import math
from collections.abc import Sequence

from terrain_estimator.discovery.evidence.soil_revision import RevisedStudy, Revision
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terramechanics.terrain.soil import CONSTANTS, Soil


def on_other_soil(told: Study, soils: Sequence[Soil], least: float) -> RevisedStudy | None:
    """Return the study on those of ``soils`` that explain the runs best.

    The runs of one soil as told are moved to another after those of the soil before. What a soil
    explains includes a discrepancy without a name: nothing else is known to be missing yet. None
    where no soil explains ``least`` [nat] more than nothing on the soils as told.
    """
    best: RevisedStudy | None = None
    for own in dict.fromkeys(told.soils):
        moved = best.study.nominal.revised if best else ()
        tried = [
            _moved(told, (*moved, (own, soil)), len(soils))
            for soil in soils
            if soil.law == own.law and not _alike(soil, own)
        ]
        candidates = [best, *tried] if best else tried
        best = max(candidates, key=lambda each: each.gain(each.study.free, told), default=None)
    return best if best and best.gain(best.study.free, told) >= least else None


def _moved(told: Study, moved: tuple[tuple[Soil, Soil], ...], soils: int) -> RevisedStudy:
    """Return the study with the runs of some soils as told moved to others."""
    nominal = dataclasses.replace(told.nominal, revised=moved)
    study = Study(nominal, told.runs, told.mask, told.contributions)
    revisions = tuple(_revision(told, own, soil) for own, soil in moved)
    return RevisedStudy(study, revisions, len(moved) * math.log(1.0 + soils), study.nothing)


def _revision(told: Study, own: Soil, soil: Soil) -> Revision:
    """Return what is known of the constants of ``soil``: its file, with the doubt of any file."""
    doubt = nominal_of(told.nominal.rover, soil, told.nominal.prior).uncertain.square().sum(0)
    sd = {
        name: math.sqrt(square)
        for name, square in zip(CONSTANTS, doubt.tolist(), strict=True)
        if square > 0.0
    }
    runs = sum(each == own for each in told.soils)
    return Revision(own, soil, runs, sd, of_file=True)


def _alike(one: Soil, other: Soil) -> bool:
    """Return whether two soils have the same constants."""
    return all(getattr(one, name) == getattr(other, name) for name in CONSTANTS)
