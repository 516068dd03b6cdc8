# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives on two soils in one study, with nothing missing."""

from dataclasses import replace
from functools import cache

import torch

from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.proof.proof import prove
from terrain_estimator.discovery.runs import Blocks, RecordedRun, cut
from terrain_estimator.learning.tasks import measure_tasks
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch

MARS = load_rover("mars_rover")
SOILS = [load_soil("loose_sand"), load_soil("regolith")]
STRENGTH = ((2500.0, 0.6), (900.0, 0.75))
LOOSE = nominal_of(MARS, SOILS[0])


@cache
def blocks() -> list[Blocks]:
    """Return a drive of 25 s on each soil."""
    generator = torch.Generator().manual_seed(47)
    constants = torch.stack([soil.constants() for soil in SOILS])
    ground = Ground([Patch(constants, torch.tensor(STRENGTH, dtype=torch.float64))])
    drive = simulate(MARS, ground, "S1", 25.0, generator, 2)
    packed = measure_tasks(drive, Noise(), generator).measured
    time = torch.arange(packed.shape[1], dtype=torch.float64) * 0.1
    return [
        replace(
            cut(
                RecordedRun(soil.name, packed[k], drive.seen.wheel_rate[k], time),
                nominal_of(MARS, soil).contact,
            ),
            soil=soil,
        )
        for k, soil in enumerate(SOILS)
    ]


def test_each_run_is_judged_on_its_own_soil() -> None:
    with torch.inference_mode():
        right = Study(LOOSE, blocks()).nothing.fit
        wrong = Study(LOOSE, [replace(run, soil=None) for run in blocks()]).nothing.fit
    assert right.log_evidence > wrong.log_evidence + 30.0
    assert 0.6 < right.objective / right.degrees < 1.1
    for unknowns, (cohesion, friction) in zip(right.point.runs, STRENGTH, strict=True):
        assert abs(float(unknowns.theta[0]) - 1e-3 * cohesion) < 0.5
        assert abs(float(unknowns.theta[1]) - friction) < 0.1


def test_rollouts_are_simulated_on_the_soil_of_their_run() -> None:
    with torch.inference_mode():
        both = prove(LOOSE, None, blocks()).gap
        wrong = prove(LOOSE, None, [blocks()[0], replace(blocks()[1], soil=None)]).gap
    assert both is not None
    assert wrong is not None
    assert 0.8 < both.before / both.noise_floor < 1.25
    assert wrong.before > 2.0 * both.before
