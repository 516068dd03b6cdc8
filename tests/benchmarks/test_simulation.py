# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The drive that is timed in three dimensions: it turns and leans, and every step is solved."""

from dataclasses import replace

import pytest
import torch

from benchmarks import simulation
from benchmarks.simulation import STEPS, spatial_drive, turning

ROVERS = 3


def test_the_rovers_turn_to_both_sides_and_lean_on_hills() -> None:
    samples = list(turning(ROVERS, 1))
    assert len(samples) == STEPS
    assert all(bool(sample.solved.all()) for sample in samples)
    turns = torch.stack([sample.velocity[:, 2] for sample in samples])
    assert bool((turns.amax(0) > 0.004).all())
    assert bool((turns.amin(0) < -0.004).all())
    for lean in (samples[-1].roll, samples[-1].pitch):
        assert float(lean.abs().max()) > 0.01
    across = torch.stack([sample.forces[..., 3].abs().amax(-1) for sample in samples])
    assert float(across.max()) > 1.0, "N: the wheels slide sideways"


def test_a_drive_with_a_step_that_is_not_solved_gives_no_figure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = next(turning(ROVERS, 1))
    failed = replace(first, solved=torch.tensor([True, False, True]))
    monkeypatch.setattr(simulation, "turning", lambda *_: iter([first, failed]))
    with pytest.raises(ArithmeticError, match=r"1 of 6 steps are not solved"):
        spatial_drive(ROVERS, 1)
