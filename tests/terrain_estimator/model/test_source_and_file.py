# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The tracked model files compute what the source computes, which is a Kalman filter."""

import itertools

import pytest
import torch
from torch import Tensor

from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.tasks import draw_tasks
from terrain_estimator.model.hypotheses import HAZARD, ZERO_PRECISION
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import model_names
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packed_observation import BLOCK, PACKED_SCALAR_FIELDS
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.parameters import ROVER_PARAMETERS
from terrain_estimator.model.velocity import MEMORY, OPEN

State = dict[str, Tensor]
STEP_S = 0.1


def place(name: str) -> int:
    """Of a scalar in a packed observation, from its end."""
    return PACKED_SCALAR_FIELDS.index(name) - len(PACKED_SCALAR_FIELDS)


def drive(loaded: LoadedModel, soils: tuple[int, ...], seconds: float = 3.0) -> Tensor:
    """Packed observations that change from one soil to the next."""
    parts = [
        draw_tasks(
            loaded.rover, loaded.metadata.soils[soil], "S1", seconds, 1,
            torch.Generator().manual_seed(3 + soil),
        ).measured[0]
        for soil in soils
    ]  # fmt: skip
    return torch.cat(parts)


def troubled(loaded: LoadedModel) -> Tensor:
    """A drive over two soils, with gaps, wheels out of range, and sensors that fail."""
    packed = drive(loaded, (0, 1))
    packed[33, place("linked")] = 0.0
    packed[12:14, 0] = torch.nan
    packed[18:24, place("acceleration")] = torch.nan
    packed[41:, place("bogie_angle")] = torch.nan
    packed[47, 2 * len(loaded.rover.axle_x)] = 10.0
    return packed


@pytest.fixture(name="pair", scope="module", params=model_names())
def source_and_file(request: pytest.FixtureRequest) -> tuple[PAlpaca, LoadedModel]:
    loaded = load_model(request.param)
    return restore(loaded), loaded


def same(mine: State, theirs: State) -> None:
    assert mine.keys() == theirs.keys()
    for name, value in mine.items():
        torch.testing.assert_close(
            value, theirs[name], rtol=1e-6, atol=1e-9, equal_nan=True, msg=f"{name} differs"
        )


def test_a_drive_gives_the_same_state_after_every_observation(
    pair: tuple[PAlpaca, LoadedModel],
) -> None:
    model, loaded = pair
    here, there = model.initial(), loaded.module.initial()
    with torch.inference_mode():
        for observation in troubled(loaded):
            expected = loaded.module.predict(there, observation)
            torch.testing.assert_close(model.predict(here, observation), expected, equal_nan=True)
            here, there = model.update(here, observation), loaded.module.update(there, observation)
            same(here, there)
            torch.testing.assert_close(model.estimate(here), loaded.module.estimate(there))
        same(model.discard(here), loaded.module.discard(there))


def test_a_users_prior_gives_the_same_states(pair: tuple[PAlpaca, LoadedModel]) -> None:
    """The ground drifts, one soil is excluded, and the strength is known beforehand."""
    model, loaded = pair
    mean, sd = torch.tensor([1500.0, 0.5]).double(), torch.tensor([700.0, 0.1]).double()
    soils = torch.tensor([0.0, 0.7, 0.3]).double()
    here = model.initial_with_prior(mean, sd, soils, 0.05)
    there = loaded.module.initial_with_prior(mean, sd, soils, 0.05)
    same(here, there)
    with torch.inference_mode():
        for observation in drive(loaded, (0,)):
            here, there = model.update(here, observation), loaded.module.update(there, observation)
        same(here, there)
    assert float(here["soils"][0]) == 0.0


# what holds of the source by itself


@pytest.fixture(name="model", scope="module")
def python_model() -> PAlpaca:
    return restore(load_model("mars_rover_with_net"))


@pytest.fixture(name="observations", scope="module")
def plain_drive() -> Tensor:
    return drive(load_model("mars_rover"), (0,), 2.4)


@pytest.mark.parametrize("mean", [(1500.0, 0.5), (100.0, 0.05)])
def test_before_anything_is_measured_the_mixture_is_the_prior(
    model: PAlpaca, mean: tuple[float, float]
) -> None:
    """Also close to zero, where a part of it is not physical."""
    sd, soils = torch.tensor([900.0, 0.2]).double(), torch.tensor([0.2, 0.5, 0.3]).double()
    state = model.initial_with_prior(torch.tensor(mean).double(), sd, soils, 0.0)
    estimate = model.estimate(state)
    torch.testing.assert_close(estimate[0], torch.tensor(mean).double())
    torch.testing.assert_close(estimate[1:], torch.diag(sd**2), rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(state["soils"], soils)
    assert float(state["weight"].sum()) == pytest.approx(1.0)
    assert bool(torch.isnan(torch.stack(model.velocity.forecast(state, STEP_S))).all())
    assert bool(torch.isnan(torch.stack([state["forecast"], state["forecast_variance"]])).all())


def test_an_innovation_is_what_differs_from_the_prediction(
    model: PAlpaca, observations: Tensor
) -> None:
    """And the velocity moves by it as in a scalar Kalman filter, inside a block."""
    state = model.update(model.initial(), observations[0])
    speed, deviation = place("velocity"), place("velocity_sd")
    for observation in observations[1 : BLOCK - 1]:
        mean, variance = model.predict(state, observation).unbind(0)
        state = model.update(state, observation)
        innovation, total = state["innovation"], state["innovation_variance"]
        noise = observation[deviation] ** 2
        torch.testing.assert_close(innovation, observation[speed] - mean)
        torch.testing.assert_close(total, variance)
        gain = (variance - noise) / variance
        torch.testing.assert_close(state["velocity"], mean + gain * innovation)
        torch.testing.assert_close(state["velocity_variance"], gain * noise)


def test_a_forecast_goes_on_with_the_acceleration_and_ever_less_surely(
    model: PAlpaca, observations: Tensor
) -> None:
    """Its variance is a parabola in the horizon whose start is that of the velocity."""
    state = model.initial()
    for observation in observations[:15]:
        state = model.update(state, observation)
    now, near, far = (model.velocity.forecast(state, h) for h in (0.0, 0.5, 1.0))
    assert now == (state["velocity"], state["velocity_variance"])
    torch.testing.assert_close(far[0] - near[0], near[0] - now[0])
    torch.testing.assert_close(near[0] - now[0], 0.5 * state["acceleration"])
    bend = 2.0 * (far[1] - 2.0 * near[1] + now[1])
    change = state["change"] / state["change_weight"]
    walk = (change - 2.0 * state["feature_noise"]).clamp(min=0.0)
    spread, shared = state["acceleration_variance"], state["velocity_acceleration_covariance"]
    torch.testing.assert_close(bend, spread + walk, rtol=1e-6, atol=0.0)
    torch.testing.assert_close(far[1] - now[1] - bend, 2.0 * shared, rtol=1e-6, atol=1e-15)
    ahead = model.velocity.forecast(state, STEP_S)
    assert ahead == (state["forecast"], state["forecast_variance"])


def test_changes_of_the_acceleration_are_remembered_with_falling_weight(
    model: PAlpaca, observations: Tensor
) -> None:
    state = model.update(model.initial(), observations[0])
    accelerations: list[float] = []
    for observation in observations[1:9]:
        state = model.update(state, observation)
        accelerations.append(float(state["acceleration"]))
    change, seen = 0.0, 0.0
    for before, after in itertools.pairwise(accelerations):
        change = (1.0 - MEMORY) * change + MEMORY * (after - before) ** 2
        seen = (1.0 - MEMORY) * seen + MEMORY
    assert float(state["change"]) == pytest.approx(change, rel=1e-9)
    assert float(state["change_weight"]) == pytest.approx(seen, rel=1e-9)


def test_a_discarded_block_leaves_the_ground_as_it_was_and_opens_the_velocity(
    model: PAlpaca, observations: Tensor
) -> None:
    state = model.initial()
    for observation in observations[:BLOCK]:
        state = model.update(state, observation)
    before = model.estimate(state)
    for observation in observations[BLOCK : BLOCK + 4]:
        state = model.update(state, observation)
    dropped = model.discard(state)
    assert dropped["block"].shape[0] == 0
    torch.testing.assert_close(model.estimate(dropped), before)
    assert float(dropped["velocity_variance"]) == pytest.approx(1.0 / OPEN)
    torch.testing.assert_close(dropped["velocity"], state["velocity"])
    covariance = torch.linalg.inv(dropped["precision"])
    torch.testing.assert_close(
        covariance[:, :2, :2], torch.linalg.inv(state["precision"])[:, :2, :2]
    )
    torch.testing.assert_close(
        covariance[:, -1, -1], torch.full_like(covariance[:, -1, -1], 1.0 / OPEN)
    )
    assert not covariance[:, -1, :-1].abs().max() > 1e-12


def test_what_is_started_anew_is_the_prior_with_the_rovers_own_parameters(
    model: PAlpaca, observations: Tensor
) -> None:
    """Four Gaussians whose mixture has mean and covariance of the prior in c and tan phi."""
    state = model.initial()
    for observation in observations[: 2 * BLOCK]:
        state = model.update(state, observation)
    anew, layout = model.hypotheses.restart(state, 1), model.layout
    kept, first_constant = ROVER_PARAMETERS, layout.first_constant
    assert kept == layout.size - layout.first_effect  # it has no effects
    covariance = torch.linalg.inv(anew.precision)
    mean, sd = state["prior_mean"], state["prior_sd"]
    torch.testing.assert_close(anew.mean[:, :2].mean(0), mean)
    spread = anew.mean[:, :2] - mean
    whole = covariance[:, :2, :2].mean(0) + spread.T @ spread / 4.0
    torch.testing.assert_close(whole, torch.diag(sd**2))
    torch.testing.assert_close(anew.mean[:, -kept:], state["expected"][-kept:].expand(4, kept))
    torch.testing.assert_close(
        covariance[:, -kept:, -kept:],
        state["covariance"][-kept:, -kept:].expand(4, kept, kept),
        rtol=1e-6,
        atol=1e-12,
    )
    without_net = covariance[:, 2:first_constant, 2:first_constant]
    torch.testing.assert_close(
        without_net.diagonal(dim1=1, dim2=2),
        torch.full_like(without_net[..., 0], 1.0 / ZERO_PRECISION),
    )
    # prior mass: the four share the hazard, times the soil's prior, over what is physical of each
    physical = torch.distributions.Normal(
        0.0, 1.0
    ).cdf(  # type: ignore[no-untyped-call]
        anew.mean[:, :2] / covariance[:, [0, 1], [0, 1]].sqrt()
    )
    weight = anew.log_weight.exp() * physical.prod(1)
    torch.testing.assert_close(weight, torch.full_like(weight, HAZARD / 4.0 / 3.0))


def test_drifting_ground_is_forgotten_at_the_rate_that_the_user_gives(model: PAlpaca) -> None:
    """The covariance of c and tan phi of every posterior grows by drift^2 t of the prior's."""
    sd, soils = torch.tensor([900.0, 0.2]).double(), torch.full((3,), 1.0 / 3.0).double()
    state = model.initial_with_prior(torch.tensor([1500.0, 0.5]).double(), sd, soils, 0.3)
    later = model.hypotheses.diffuse(state, torch.tensor(2.0).double())
    grown = torch.linalg.inv(later["precision"]) - torch.linalg.inv(state["precision"])
    expected = torch.zeros_like(grown)
    unit = torch.tensor([1e3, 1.0]).double()
    expected[:, [0, 1], [0, 1]] = 2.0 * (0.3 * sd / unit) ** 2
    torch.testing.assert_close(grown, expected, rtol=1e-6, atol=1e-9)
    still = model.hypotheses.diffuse(model.initial(), torch.tensor(2.0).double())
    assert torch.equal(still["precision"], model.initial()["precision"])
