# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The named view of a packed observation, and the functions that replace its parts."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from terrain_estimator.model.packed_observation import (
    GROUPS,
    PACKED_SCALAR_FIELDS,
    PACKED_WHEEL_FIELDS,
    ground_torque,
    link,
    pack,
    packed_size,
    scalar_fields,
)
from terrain_estimator.model.packing import (
    PackedView,
    view_of,
    with_acceleration,
    with_contact_angle,
    with_pitch,
    with_sinkage,
    with_slip,
    with_slip_and_sd,
    with_stand_in,
    with_torque,
    without_link,
)
from terrain_estimator.observation import Observation

WHEELS = 3
STEP_S = 0.2


def observation() -> Observation:
    """Return an observation of which every number is another."""
    numbers = iter(range(1, 100))

    def wheels() -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array([float(next(numbers)) for _ in range(WHEELS)])

    values = {name: wheels() for name in (*PACKED_WHEEL_FIELDS, "wheel_rate")}
    scalars = {name: float(next(numbers)) for name in PACKED_SCALAR_FIELDS[:-2]}
    return Observation(stamp_ns=0, **values, **scalars)  # type: ignore[arg-type]


def packed(*, rates: bool, linked: bool = True) -> Tensor:
    seen = observation()
    return torch.from_numpy(pack(seen, seen.torque.tolist(), STEP_S, linked=linked, rates=rates))


@pytest.mark.parametrize("rates", [False, True])
def test_the_view_has_each_number_under_the_name_that_the_observation_has(*, rates: bool) -> None:
    seen, view = observation(), view_of(packed(rates=rates), WHEELS)
    for name in (*PACKED_WHEEL_FIELDS, *PACKED_SCALAR_FIELDS[:-2]):
        assert getattr(view, name).tolist() == np.asarray(getattr(seen, name)).tolist(), name
    assert view.wheel_rate.tolist() == (seen.wheel_rate.tolist() if rates else [])
    assert (view.step.item(), view.linked.item()) == (STEP_S, 1.0)
    assert view_of(packed(rates=rates, linked=False), WHEELS).linked.item() == 0.0
    assert view.packed.shape == (packed_size(WHEELS, rates=rates),)


@pytest.mark.parametrize("layout", ["as today", "with steering", "with steering and slip angle"])
@pytest.mark.parametrize("rates", [False, True])
@pytest.mark.parametrize("scripted", [False, True])
def test_steering_and_slip_angle_come_with_zero_wheels_unless_a_layout_has_them(
    layout: str, *, rates: bool, scripted: bool
) -> None:
    own = {
        "as today": {},
        "with steering": {"steering": [0.3, 0.0, -0.2]},
        "with steering and slip angle": {
            "steering": [0.3, 0.0, -0.2],
            "slip_angle": [0.1, 0.2, 0.4],
        },
    }[layout]
    old, groups = packed(rates=rates), GROUPS + len(own)
    more = torch.tensor(list(own.values()), dtype=torch.float64).flatten()
    wide = torch.cat([old[: GROUPS * WHEELS], more, old[GROUPS * WHEELS :]])
    function = torch.jit.script(view_of) if scripted else view_of
    view, plain = function(wide, WHEELS, groups), view_of(old, WHEELS)
    for name in ("steering", "slip_angle"):
        assert getattr(view, name).tolist() == own.get(name, [])
        assert getattr(plain, name).shape == (0,)
    for name in {*PackedView._fields} - {"packed", "steering", "slip_angle"}:
        assert torch.equal(getattr(view, name), getattr(plain, name)), name


@pytest.mark.parametrize("inertia", [0.0, 0.4, 1.0])
def test_the_torque_on_the_ground_is_the_motors_less_what_turns_the_wheel(inertia: float) -> None:
    """Banerjee et al. eq. 6: M - I dw/dt, with the rates of two observations."""
    seen, passed_s = observation(), 0.25
    before = dataclasses.replace(seen, wheel_rate=seen.wheel_rate - [0.5, 0.0, -0.25])
    expected = seen.torque - inertia * np.array([2.0, 0.0, -1.0])
    np.testing.assert_allclose(ground_torque(seen, before, inertia, passed_s), expected)
    np.testing.assert_array_equal(ground_torque(seen, None, inertia, passed_s), seen.torque)


@pytest.mark.parametrize(("steps", "linked"), [(1.0, True), (2.4, True), (2.6, False)])
def test_a_velocity_carries_over_to_an_observation_that_follows_soon(
    steps: float, *, linked: bool
) -> None:
    last = observation()
    passed_s, carries = link(round(steps * 1e8), last, 0.1)
    assert passed_s == pytest.approx(0.1 * steps)
    assert carries == linked
    assert link(7, None, 0.1) == (0.1, False)


def test_the_fields_of_a_model_file_stand_in_the_order_of_the_layout() -> None:
    assert scalar_fields(WHEELS, rates=False) == PACKED_SCALAR_FIELDS
    turning = ("wheel_rate_0", "wheel_rate_1", "wheel_rate_2")
    with_rates = scalar_fields(WHEELS, rates=True)
    assert with_rates == (*PACKED_SCALAR_FIELDS[:-2], *turning, *PACKED_SCALAR_FIELDS[-2:])


def test_the_view_of_many_drives_is_that_of_each_observation() -> None:
    drives = torch.rand(2, 5, packed_size(WHEELS, rates=True), dtype=torch.float64)
    whole = view_of(drives, WHEELS)
    for name, one in view_of(drives[1, 3], WHEELS)._asdict().items():
        assert torch.equal(getattr(whole, name)[1, 3], one), name


WHEEL = torch.tensor([91.0, 92.0, 93.0], dtype=torch.float64)
REPLACED: dict[str, Callable[[Tensor], Tensor]] = {
    "slip": lambda old: with_slip(old, WHEEL),
    "sinkage": lambda old: with_sinkage(old, WHEEL),
    "contact_angle": lambda old: with_contact_angle(old, WHEEL),
    "torque": lambda old: with_torque(old, WHEEL),
    "pitch": lambda old: with_pitch(old, WHEEL[0], WHEELS),
    "acceleration": lambda old: with_acceleration(old, WHEEL[0], WHEELS),
    "slip, slip_sd": lambda old: with_slip_and_sd(old, WHEEL, WHEEL),
    "step, linked": without_link,
}


@pytest.mark.parametrize("rates", [False, True])
@pytest.mark.parametrize("names", REPLACED)
def test_a_replaced_part_is_the_only_one_that_changes(names: str, *, rates: bool) -> None:
    old = packed(rates=rates)
    before, after = view_of(old, WHEELS), view_of(REPLACED[names](old), WHEELS)
    changed = {
        name
        for name in PackedView._fields
        if not torch.equal(getattr(before, name), getattr(after, name))
    }
    assert changed == {"packed", *names.split(", ")}
    for name in names.split(", "):
        expected = 0.0 if name in ("step", "linked") else WHEEL.tolist()
        found = getattr(after, name).tolist()
        assert found == (WHEEL[0].item() if name in ("pitch", "acceleration") else expected)


def test_a_stand_in_takes_the_place_of_the_wheels_that_are_not_usable_alone() -> None:
    old = packed(rates=True)
    usable = torch.tensor([True, False, True])
    stand_in = torch.arange(8.0, dtype=torch.float64).unsqueeze(1) - 100.0
    before = view_of(old, WHEELS)
    after = view_of(with_stand_in(old, usable, stand_in), WHEELS)
    for k, name in enumerate(PACKED_WHEEL_FIELDS):
        kept = getattr(before, name).tolist()
        assert getattr(after, name).tolist() == [kept[0], k - 100.0, kept[2]]
    assert torch.equal(before.wheel_rate, after.wheel_rate)
    assert after.velocity == before.velocity
