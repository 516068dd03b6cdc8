# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A ground that is many times as stiff as its soil file says is found from another start."""

import dataclasses
from functools import cache

import torch

from terrain_estimator.discovery.evidence.soil_revision import revised, revised_alone
from terrain_estimator.discovery.evidence.soil_starts import EXPONENTS, PLACES, best_start
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.runs import Blocks, RecordedRun, cut
from terrain_estimator.learning.tasks import measure_tasks
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch

MARS = load_rover("mars_rover")
LOOSE, COMPACT = load_soil("loose_sand"), load_soil("compact_sand")
STRENGTH = ((2500.0, 0.6), (1500.0, 0.7))
ALIKE = 10.0
"""[nat] Within which constants that were found explain the runs as well as those of the truth."""


@cache
def runs(soil: str) -> tuple[Blocks, ...]:
    generator = torch.Generator().manual_seed(20261126)
    strength = torch.tensor(STRENGTH, dtype=torch.float64)
    ground = Ground([Patch(load_soil(soil).constants(), strength)])
    drive = simulate(MARS, ground, "S1", 35.0, generator, len(STRENGTH))
    packed = measure_tasks(drive, Noise(), generator).measured
    time = torch.arange(packed.shape[1], dtype=torch.float64) * 0.1
    contact = nominal_of(MARS, LOOSE).contact
    return tuple(
        cut(RecordedRun(f"{soil}_{k}", packed[k], drive.seen.wheel_rate[k], time), contact)
        for k in range(len(STRENGTH))
    )


@cache
def study(soil: str, told: str) -> Study:
    with torch.inference_mode():
        return Study(nominal_of(MARS, load_soil(told)), runs(soil))


def test_a_search_from_the_soil_file_alone_finds_nothing() -> None:
    """Why there are other starts."""
    told = study("compact_sand", "loose_sand")
    true = study("compact_sand", "compact_sand").nothing.fit.log_evidence
    with torch.inference_mode():
        near = revised(told, told.nothing)
    assert near is None or near.study.nothing.fit.log_evidence < true - 1000.0


def test_constants_are_found_that_explain_the_runs_like_the_true_ones() -> None:
    told = study("compact_sand", "loose_sand")
    true = study("compact_sand", "compact_sand").nothing.fit.log_evidence
    with torch.inference_mode():
        found = revised_alone(told, enough=float("inf"))
    assert found is not None
    assert found.study.nothing.fit.log_evidence > true - ALIKE
    assert found.gain(found.beside, told) > 1000.0
    (revision,) = found.revisions
    assert "n" in revision.moved
    assert abs(revision.found.c1 - COMPACT.c1) < 0.1 * COMPACT.c1


def test_the_best_start_is_firm_and_carries_the_rover() -> None:
    with torch.inference_mode():
        start = best_start(study("compact_sand", "loose_sand"))
    soil = start.nominal.soil_of(LOOSE)
    assert (soil.n, soil.c1) == (EXPONENTS[0], PLACES[1])
    assert 0.3 < soil.k_phi / COMPACT.k_phi < 3.0
    assert soil.k_c / soil.k_phi == LOOSE.k_c / LOOSE.k_phi


def test_a_soil_file_that_is_right_is_the_best_start() -> None:
    with torch.inference_mode():
        start = best_start(study("loose_sand", "loose_sand"))
    assert start.nominal.soil_of(LOOSE) == LOOSE


def test_of_two_soils_only_the_wrong_one_is_left() -> None:
    firm = LOOSE.with_values(name="said_to_be_loose")
    told = [dataclasses.replace(runs("loose_sand")[0], soil=LOOSE)]
    told += [dataclasses.replace(runs("compact_sand")[0], soil=firm)]
    with torch.inference_mode():
        start = best_start(Study(nominal_of(MARS, LOOSE), told))
    assert start.nominal.soil_of(LOOSE) == LOOSE
    assert start.nominal.soil_of(firm).n == EXPONENTS[0]
