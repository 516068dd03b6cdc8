# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of the shipped model over random ground, beside the Cramer-Rao bound."""

import numpy as np
import torch
from scipy.stats import binomtest

from studies.batched import run
from studies.bound import cramer_rao
from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.tasks import draw_tasks
from terrain_estimator.learning.training import build_model
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packing import view_of
from tests.samples import sampled

EPISODES, DURATION_S = sampled(50, 100), 40.0
HALF_NORMAL_MEDIAN = 0.6745  # median of |x| in standard deviations


def test_median_errors_of_the_papers_rover_on_loose_sand_are_at_most_ten_percent() -> None:
    """Random S1 episodes of 40 s, exact soil constants, all rows but the accelerometer's.

    Beside the bars of 10 %: the error is at most 1.5 times the Cramer-Rao bound, and the 95 %
    intervals cover a share whose 99 % confidence limits do not exclude 95 %.
    """
    model = load_model("paper_rover")
    tasks = draw_tasks(
        model.rover,
        model.metadata.soils[0],
        "S1",
        DURATION_S,
        EPISODES,
        torch.Generator().manual_seed(20_000),
        spread=0.0,
    )
    measured = tasks.measured.clone()
    view_of(measured, model.rover.axles).acceleration.fill_(torch.nan)
    trace = run(restore(model), measured, torch.tensor([measured.shape[1] - 1]))
    error = (trace.mean[:, 0] - tasks.strength).abs()
    relative = (error / tasks.strength).median(0).values
    assert (relative <= 0.10).all(), relative

    view_of(tasks.true, model.rover.axles).acceleration.fill_(torch.nan)
    physics = build_model(model.rover, model.metadata.soils)
    bound = cramer_rao(physics, tasks).diagonal(dim1=1, dim2=2).sqrt()
    ratio = (error / bound).median(0).values / HALF_NORMAL_MEDIAN
    assert (ratio < 1.5).all(), ratio

    deviation = trace.covariance[:, 0].diagonal(dim1=1, dim2=2).sqrt()
    for name, covered in zip(
        ("c", "tan phi"), (error < 1.96 * deviation).sum(0).tolist(), strict=True
    ):
        interval = binomtest(covered, EPISODES).proportion_ci(0.99)
        assert interval.low <= 0.95 <= interval.high, (name, covered / EPISODES)
    errors, ratios = np.round(relative.numpy() * 100, 1), np.round(ratio.numpy(), 2)
    print(f"median error {errors} %, ratio to the bound {ratios}")  # noqa: T201
