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

    What a soil explains includes a discrepancy without a name: nothing else is known to be missing
    yet. Of several soils as told one is moved after the other, where that explains more. None where
    no soil explains ``least`` [nat] more than nothing on the soils as told.
    """
    own_soils = list(dict.fromkeys(told.soils))
    best: RevisedStudy | None = None
    most = told.gain(told.free) if len(own_soils) > 1 else -math.inf
    for own in own_soils * len(own_soils):  # a move may gain only after that of a later soil
        before = best
        if before is not None and own in dict(before.study.nominal.revised):
            continue
        others = [soil for soil in soils if soil.law == own.law and not alike(soil, own)]
        for soil in others:
            there = _moved(told, before, own, soil, math.log(1.0 + len(others)))
            if (gain := there.gain(there.study.free, told)) > most:
                best, most = there, gain
    return best if most >= least else None


def _moved(
    told: Study, before: RevisedStudy | None, own: Soil, soil: Soil, price: float
) -> RevisedStudy:
    """Return the study with the runs of ``own`` on ``soil``, others as ``before``."""
    moved = (*(before.study.nominal.revised if before else ()), (own, soil))
    study = Study(
        dataclasses.replace(told.nominal, revised=moved), told.runs, told.mask, told.contributions
    )
    revisions = tuple(_revision(told, first, second) for first, second in moved)
    price += before.price if before else 0.0
    return RevisedStudy(study, revisions, price, study.nothing)


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


def alike(one: Soil, other: Soil) -> bool:
    """Return whether two soils have one law and the same constants, whatever their names."""
    return one.law == other.law and all(
        getattr(one, name) == getattr(other, name) for name in CONSTANTS
    )
