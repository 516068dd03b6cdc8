# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rows with an effect in them are unbiased where they are expanded at doubtful inputs."""

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.library import LibraryEffect
from terrain_estimator.discovery.hypotheses.rows import (
    Expansion,
    HypothesisRows,
    LinearizationPoint,
    nominal_of,
)
from terrain_estimator.discovery.runs import Blocks, RecordedRun, cut
from terrain_estimator.learning.tasks import measure_tasks
from terrain_estimator.model.packing import view_of
from terramechanics.effects import make_effect
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground
from tests.terrain_estimator.discovery.known import LOOSE, MARS

DRIVES, PAYLOAD_KG = 16, 40.0
NOMINAL, LAWS = nominal_of(MARS, LOOSE), [LibraryEffect("payload").on(MARS)]


def shifts() -> tuple[Tensor, Tensor]:
    """Return the shifts of the velocity row of all drives, with the correction and without it."""
    generator = torch.Generator().manual_seed(5)
    ground = Ground.random_strength(
        LOOSE, DRIVES, generator, cohesion=(1000.0, 4000.0), friction_angle=(0.4, 0.7)
    )
    plant = Plant([make_effect("payload", PAYLOAD_KG)])
    drive = simulate(MARS, ground, "S1", 30.0, generator, DRIVES, plant=plant)
    tasks, time = measure_tasks(drive, Noise(), generator), drive.sample.time[0]
    found = []
    for k in range(DRIVES):
        seen, true = (
            cut(RecordedRun("run", packed[k], drive.seen.wheel_rate[k], time), NOMINAL.contact)
            for packed in (tasks.measured, tasks.true)
        )
        found.append(shifts_of(seen, true, drive.sample.strength[k, 0, 0]))
    return torch.cat([each[0] for each in found]), torch.cat([each[1] for each in found])


def shifts_of(seen: Blocks, true: Blocks, strength: Tensor) -> tuple[Tensor, Tensor]:
    """Return the velocity row measured less true, beyond its linear part, over its noise."""
    strength = strength / NOMINAL.contact.column_unit[:2]
    kappa = torch.zeros(len(NOMINAL.uncertain), dtype=torch.float64)
    point = LinearizationPoint(strength, kappa, (PAYLOAD_KG, 0.0, 0.0))
    rows = HypothesisRows(NOMINAL, seen, LAWS)
    around = rows.expansion(point, torch.ones(8, dtype=torch.float64))
    certain = Expansion(around.input_correction, torch.zeros_like(around.doubt))
    here = Expansion(torch.zeros_like(around.input_correction), certain.doubt)
    exact = HypothesisRows(NOMINAL, true, LAWS).rows(point, here)
    theta = torch.cat([strength, torch.ones(1, dtype=torch.float64)])
    linear = exact.noise[0, :, 0] @ theta
    known = exact.features[0, :, 0] @ theta + (linear[:, :-1] * errors(seen, true)).sum(1)
    scale = linear.square().sum(1).sqrt()
    corrected, plain = (
        (rows.rows(point, each).features[0, :, 0] @ theta - known) / scale
        for each in (around, certain)
    )
    return corrected, plain


def errors(seen: Blocks, true: Blocks) -> Tensor:
    """Return the errors of slip, sinkage and contact angle over their deviations, [n, 3 A]."""
    a, b = (view_of(each.packed.flatten(0, 1), MARS.axles) for each in (seen, true))
    return torch.cat(
        [
            (a.slip - b.slip) / a.slip_sd,
            (a.sinkage - b.sinkage) / a.sinkage_sd,
            (a.contact_angle - b.contact_angle) / a.contact_angle_sd,
        ],
        1,
    )


def test_an_effect_in_the_rows_does_not_shift_them_on_average() -> None:
    corrected, plain = shifts()
    error = float(corrected.std()) / len(corrected) ** 0.5
    assert float(plain.mean()) < -6.0 * error
    assert abs(float(corrected.mean())) < 0.25 * abs(float(plain.mean())) + 4.0 * error
