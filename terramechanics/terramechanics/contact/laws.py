# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The contact laws by name, as a soil file names them.

Each gives the coefficients of N, T and M of a wheel, affine in c and tan(phi), for the same inputs.
"""

from collections.abc import Callable
from functools import cache
from typing import Protocol, cast

import torch
from torch import Tensor

from terramechanics.contact.scm import Rut, scm_forces
from terramechanics.contact.stresses import many_wheel_forces, wheel_forces_linear_stress
from terramechanics.terrain.soil import LINEAR_STRESS, SCM, WONG_REECE


class ContactLaw(Protocol):
    """The coefficients of the forces of a wheel, by one of the laws."""

    def __call__(
        self,
        slip: Tensor,
        sinkage: Tensor,
        constants: Tensor,
        radius: float,
        width: float,
        nodes: Tensor,
        exit_angle: Tensor | None = None,
        slip_angle: Tensor | None = None,
        rut: Rut | None = None,
    ) -> Tensor:
        """Return [..., 3, 3], or [..., 4, 3] at a slip angle; ``rut`` is that of wheels before."""


def contact_law(name: str) -> ContactLaw:
    """Return the contact law of a soil, compiled by TorchScript."""
    return _LAWS[name]


def keeps_ruts(name: str) -> bool:
    """Return whether the ground keeps what wheels did to it, under the law of that name."""
    return name == SCM


def _wong_reece(
    slip: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None = None,
    slip_angle: Tensor | None = None,
    rut: Rut | None = None,
) -> Tensor:
    del rut
    return many_wheel_forces(slip, sinkage, constants, radius, width, nodes, exit_angle, slip_angle)


@cache
def _compiled_scm() -> Callable[..., Tensor]:
    return cast("Callable[..., Tensor]", torch.jit.script(scm_forces))


def _scm(
    slip: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None = None,
    slip_angle: Tensor | None = None,
    rut: Rut | None = None,
) -> Tensor:
    if slip_angle is not None:
        raise ValueError("the contact law scm has no side force: give no slip angle")
    return _compiled_scm()(slip, sinkage, constants, radius, width, nodes, exit_angle, rut)


def _linear_stress(
    slip: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None = None,
    slip_angle: Tensor | None = None,
    rut: Rut | None = None,
) -> Tensor:
    del nodes, rut
    if exit_angle is not None or slip_angle is not None:
        raise ValueError(
            "the contact law linear_stress ends below the axle and has no side force: give no exit"
            " angle and no slip angle"
        )
    return wheel_forces_linear_stress(slip, sinkage, constants, radius, width)


_LAWS: dict[str, ContactLaw] = {
    WONG_REECE: _wong_reece,
    SCM: _scm,
    LINEAR_STRESS: _linear_stress,
}
