# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the named effects of drives change of one wheel, against their formulas."""

import dataclasses
import math
from functools import cache

import pytest
import torch

from terrain_estimator.discovery.evidence.fit import Fit
from terrain_estimator.discovery.evidence.study import Candidate
from terrain_estimator.discovery.hypotheses.library import (
    OTHER_SOIL_LAW,
    Hypothesis,
    LibraryEffect,
    together,
)
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.hypotheses.unknowns import start_of
from terrain_estimator.discovery.report.wheel_changes import wheel_changes
from terrain_estimator.discovery.runs import Blocks, RecordedRun, cut
from terrain_estimator.discovery.single_wheel.size import SLIP, Change
from terrain_estimator.learning.tasks import measure_tasks
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch

MARS, LOOSE = load_rover("mars_rover"), load_soil("loose_sand")
COHESION_PA, TAN_PHI = 1500.0, 0.6
NOMINAL = nominal_of(MARS, LOOSE)


@cache
def run() -> Blocks:
    generator = torch.Generator().manual_seed(5)
    strength = torch.tensor([[COHESION_PA, TAN_PHI]], dtype=torch.float64)
    drive = simulate(
        MARS, Ground([Patch(LOOSE.constants().unsqueeze(0), strength)]), "S1", 10.0, generator, 1
    )
    packed = measure_tasks(drive, Noise(), generator).measured
    time = torch.arange(packed.shape[1], dtype=torch.float64) * 0.1
    return cut(RecordedRun("run", packed[0], drive.seen.wheel_rate[0], time), NOMINAL.contact)


def single(name: str) -> Hypothesis:
    return Hypothesis((LibraryEffect(name),))


def changed(
    hypothesis: Hypothesis, *values: float, nominal: Nominal = NOMINAL
) -> list[Change | None]:
    """Return the changes by a fit that found these values almost exactly."""
    point = start_of([torch.zeros(2, dtype=torch.float64)], 0, nominal.prior)
    theta = torch.tensor([COHESION_PA / 1000.0, TAN_PHI], dtype=torch.float64)
    unknowns = dataclasses.replace(point.runs[0], theta=theta)
    there = dataclasses.replace(
        point, runs=(unknowns,), shared=torch.tensor(values, dtype=torch.float64)
    )
    covariance = 1e-12 * torch.eye(len(values), dtype=torch.float64)
    fit = Fit(there, there, 0.0, 0.0, 0.0, covariance, (), 0, 0)
    return wheel_changes(Candidate(hypothesis, fit), nominal, [run()])


def test_lugs_pull_by_their_law_and_leave_the_sinkage() -> None:
    """F = s (N + 2 c b l) / N_0 (1 - exp(-slip / 0.1)) at N = N_0, whose last factor is 0.95."""
    [change] = changed(single("grousers"), 8.0, 0.0)
    assert change is not None
    assert change.slip == SLIP
    assert change.load == pytest.approx(MARS.weight / 6)
    low, middle, high = change.rows["drawbar_pull"]
    assert 8.0 * 0.95 < middle < 8.0 * 0.95 * 1.6  # c b l adds to it
    assert high - low == pytest.approx(2.0 * 1.96 * OTHER_SOIL_LAW * middle, rel=0.2)
    assert change.rows["torque"][1] == pytest.approx(MARS.wheel_radius * middle, rel=1e-6)
    assert all(math.isclose(end, 0.0, abs_tol=1e-9) for end in change.rows["sinkage"])


def test_a_wheel_that_digs_sinks_deeper_and_a_wedge_pulls_less() -> None:
    both = together(single("slip_sinkage"), single("bulldozing"))
    digs, wedge = changed(both, 0.3, 0.0, 4e4, 0.0)
    assert digs is not None
    assert wedge is not None
    assert digs.rows["sinkage"][0] > 0.0
    assert wedge.rows["drawbar_pull"][2] < 0.0


def test_what_no_wheel_alone_shows_has_no_change() -> None:
    assert changed(single("drive_drag"), 0.2) == [None]
    scm = dataclasses.replace(NOMINAL, soil=dataclasses.replace(LOOSE, law="scm", c2=0.0))
    assert changed(single("grousers"), 8.0, 0.0, nominal=scm) == [None]


def test_a_wheel_that_drowns_has_no_change() -> None:
    """No depth of soil this soft carries the wheel: the end of the search is no equilibrium."""
    soft = dataclasses.replace(NOMINAL, soil=dataclasses.replace(LOOSE, k_c=0.0, k_phi=2000.0))
    assert changed(single("grousers"), 8.0, 0.0, nominal=soft) == [None]
