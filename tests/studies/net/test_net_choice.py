# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The data decide whether the net counts."""

import pytest
import torch

from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.tasks import draw_tasks
from terrain_estimator.model.hypotheses import WITH_NET
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.state import State
from terramechanics.effects import make_effect
from terramechanics.simulation.plant import Plant


def with_net(state: State, soils: int) -> float:
    """Return the probability of the hypotheses with the net."""
    return float(state["weight"][state["kind"] >= soils].sum())


def test_the_net_starts_with_its_prior_probability_and_changes_nothing_of_the_prior() -> None:
    model = restore(load_model("mars_rover_with_net"))
    state = model.initial()
    assert with_net(state, model.known_soils) == pytest.approx(WITH_NET, rel=1e-12)
    torch.testing.assert_close(state["soils"], torch.full((3,), 1.0 / 3.0, dtype=torch.float64))
    expected = torch.stack(
        [model.hypotheses.prior_mean, *model.hypotheses.prior_sd.square().diag()]
    )
    torch.testing.assert_close(model.estimate(state), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("plant", "chosen"), [(None, False), (Plant([make_effect("drive_drag", 0.4)]), True)]
)
def test_a_drive_with_a_hidden_drag_turns_to_the_net_and_one_without_does_not(
    plant: Plant | None, *, chosen: bool
) -> None:
    """Draw one drive of 10 s each."""
    loaded = load_model("mars_rover_with_net")
    drive = draw_tasks(
        loaded.rover,
        loaded.metadata.soils[0],
        "S1",
        10.0,
        1,
        torch.Generator().manual_seed(2),
        plant=plant,
    ).measured[0]
    with torch.inference_mode():
        state = loaded.module.initial()
        for observation in drive:
            state = loaded.module.update(state, observation)
    assert (with_net(state, 3) > 0.99) if chosen else (with_net(state, 3) < 0.01)
