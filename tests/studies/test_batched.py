# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The batched recursion is the streaming model."""

import pytest
import torch

from studies.batched import run
from terrain_estimator.learning.restore import physics_alone, restore
from terrain_estimator.learning.tasks import draw_tasks
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packing import view_of


@pytest.mark.parametrize("name", ["mars_rover", "paper_rover"])
def test_a_batch_gives_what_the_exported_model_gives_for_each_drive(name: str) -> None:
    """Estimates within 1e-6 of a standard deviation, innovations and misfits to rounding; one drive has broken links and an early end."""
    loaded = load_model(name)
    tasks = draw_tasks(
        loaded.rover, loaded.metadata.soils[0], "S1", 12.0, 4, torch.Generator().manual_seed(5)
    )
    packed = tasks.measured.clone()
    view_of(packed, 3).acceleration.fill_(torch.nan)
    view_of(packed, 3).slip[3, [7, 8, 43], 0] = torch.nan
    times, ends = torch.tensor([39, 79, 119]), torch.tensor([120, 120, 120, 90])
    trace = run(restore(loaded), packed, times, ends)
    for drive in range(4):
        with torch.inference_mode():
            states = [loaded.module.initial()]
            for observation in packed[drive, : int(ends[drive])]:
                states.append(loaded.module.update(states[-1], observation))
            estimates = [
                loaded.module.estimate(states[min(int(t) + 1, len(states) - 1)]) for t in times
            ]
        for k, expected in enumerate(estimates):
            deviation = expected[1:].diagonal().sqrt()
            assert ((trace.mean[drive, k] - expected[0]).abs() / deviation).max() < 1e-6
            assert (
                (trace.covariance[drive, k] - expected[1:]).abs()
                / torch.outer(deviation, deviation)
            ).max() < 1e-6
        innovation, variance = (
            torch.stack([state[name] for state in states[1:]])
            for name in ("innovation", "innovation_variance")
        )
        length = innovation.shape[0]
        torch.testing.assert_close(trace.innovation[drive, :length], innovation, equal_nan=True)
        torch.testing.assert_close(trace.variance[drive, :length], variance, equal_nan=True)
        assert torch.isnan(trace.innovation[drive, length:]).all()
        misfits = trace.misfit[drive, ~torch.isnan(trace.misfit[drive])]
        torch.testing.assert_close(misfits[-1], states[-1]["misfit"])


def test_a_masked_row_is_a_row_that_was_not_measured() -> None:
    """Torque rows masked give the estimates of NaN torques; with every row masked the prior stays."""
    loaded = load_model("mars_rover")
    tasks = draw_tasks(
        loaded.rover, loaded.metadata.soils[0], "S1", 6.0, 3, torch.Generator().manual_seed(6)
    )
    model, times = (
        physics_alone(loaded.rover, loaded.metadata.soils[0], exact=True),
        torch.tensor([59]),
    )
    mask = torch.ones(8, dtype=torch.float64)
    mask[2:5] = 0.0
    unmeasured = tasks.measured.clone()
    view_of(unmeasured, 3).torque.fill_(torch.nan)
    masked = run(model, tasks.measured, times, rows=mask)
    torch.testing.assert_close(masked.mean, run(model, unmeasured, times).mean, rtol=1e-9, atol=0.0)
    nothing = run(model, tasks.measured, times, rows=torch.zeros(8, dtype=torch.float64))
    torch.testing.assert_close(
        nothing.mean[:, 0], model.hypotheses.prior_mean.expand(3, 2), rtol=1e-6, atol=0.0
    )
    assert (masked.covariance[:, 0, 0, 0] < 0.9 * nothing.covariance[:, 0, 0, 0]).all()


def test_a_batch_changes_its_ground_as_the_exported_model_does() -> None:
    """From loose to compact sand, sharply and at once under all axles: births, deaths, mergers and another soil in every drive."""
    loaded = load_model("mars_rover")
    before, after = (
        draw_tasks(loaded.rover, soil, "S1", 8.0, 3, torch.Generator().manual_seed(7)).measured
        for soil in loaded.metadata.soils[:2]
    )
    packed = torch.cat([before, after], 1)
    view_of(packed, 3).linked[:, 80] = 0.0  # the velocity is not linked
    trace = run(restore(loaded), packed, torch.tensor([79, 99, 159]))
    soils = []
    for drive in range(3):
        with torch.inference_mode():
            states = [loaded.module.initial()]
            for observation in packed[drive]:
                states.append(loaded.module.update(states[-1], observation))
            for k, time in enumerate((79, 99, 159)):
                expected = loaded.module.estimate(states[time + 1])
                deviation = expected[1:].diagonal().sqrt()
                assert ((trace.mean[drive, k] - expected[0]).abs() / deviation).max() < 1e-6
                assert (
                    (trace.covariance[drive, k] - expected[1:]).abs()
                    / torch.outer(deviation, deviation)
                ).max() < 1e-6
        assert len({state["mean"].shape[0] for state in states}) > 2
        soils.append((int(states[80]["soils"].argmax()), int(states[-1]["soils"].argmax())))
    assert all(last == 1 != first for first, last in soils)
