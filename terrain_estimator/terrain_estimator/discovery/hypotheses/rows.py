# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of one run under a hypothesis, by the row building that models share."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.effect_rows import EffectRows, Observed
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior, uncertain_constants
from terrain_estimator.model.rows import (
    MOMENT_VARIANCE,
    PA_PER_UNIT,
    ContactModel,
    Rows,
    values_alone,
)
from terrain_estimator.model.stencil import stencil
from terramechanics.contact.stresses import quadrature
from terramechanics.effects.law import Law
from terramechanics.simulation.plant import ContactInputs
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import geometry_of

_POINTS = 4
"""Nodes of the quadrature: forces within about 1e-4, below the noise, in two thirds of the time."""


@dataclass(frozen=True, slots=True)
class Nominal:
    """Rover and soil as their files have them."""

    rover: Rover
    soil: Soil
    contact: ContactModel
    uncertain: Tensor  # [M, 6] prior deviations of the uncertain soil constants
    prior: Prior


def nominal_of(rover: Rover, soil: Soil, prior: Prior = DEFAULT_PRIOR) -> Nominal:
    """Return the nominal model; ``prior`` is that of the model which may lack an effect."""
    constants = soil.constants().unsqueeze(0)
    uncertain = uncertain_constants(constants, prior.constants_sd, rover.wheel_width)[0]
    stand_in = torch.tensor(
        [0.1, 0.01, 0.01 * rover.wheel_radius, 1e-3 * rover.wheel_radius, 0.0, 0.0, 0.0, 0.0],
        dtype=torch.float64,
    )
    wheels, weight = rover.wheels_per_axle, rover.mass * rover.gravity
    by_moment = wheels / (weight * (rover.axle_x[0] - rover.axle_x[-1]))
    contact = ContactModel(
        constants=soil.constants(),
        varied=torch.cat([torch.zeros(1, 6, dtype=torch.float64), 1e-3 * uncertain]),
        stencil=stencil(uncertain.shape[0]),
        nodes=quadrature(_POINTS),
        column_unit=torch.tensor([PA_PER_UNIT, 1.0, 1.0], dtype=torch.float64),
        geometry=geometry_of(rover),
        body_scale=torch.tensor(
            [wheels / rover.mass, wheels / weight, by_moment, by_moment], dtype=torch.float64
        ),
        moment_variance=MOMENT_VARIANCE,
        stand_in=stand_in.unsqueeze(1),
        gravity=rover.gravity,
        radius=rover.wheel_radius,
        width=rover.wheel_width,
    )
    return Nominal(rover, soil, contact, uncertain, prior)


@dataclass(frozen=True, slots=True)
class LinearizationPoint:
    """Parameters at which the rows of a run are evaluated."""

    theta: Tensor  # [2] c [kPa], tan phi
    kappa: Tensor  # [M] soil constants, in prior deviations
    values: tuple[float, ...]  # of the hypothesis' effects


class Expansion(NamedTuple):
    """The inputs of n observations around which rows are expanded."""

    input_correction: Tensor  # [n, P] less the measured ones
    doubt: Tensor  # [n, 3, A] as of :class:`Agreement`


class HypothesisRows:
    """The rows of one run under one hypothesis, at any point."""

    def __init__(self, nominal: Nominal, blocks: Blocks, laws: Sequence[Law]) -> None:
        """Prepare what does not depend on the point; ``laws`` are those of the hypothesis."""
        self._nominal, self._observed = nominal, observed_of(blocks)
        self._rows = EffectRows(laws, nominal.rover.mass, RememberedIntegrals())

    def expansion(self, point: LinearizationPoint, chosen: Tensor) -> Expansion:
        """Return the inputs at which the ``chosen`` rows agree best, see :func:`agreement`."""
        packed = self._rows.corrected(self._observed, _tensor(point.values))
        straight = self._at(point, torch.zeros_like(packed), None, changes_too=False)
        theta = torch.cat([point.theta, torch.ones_like(point.theta[:1])])
        agreed = agreement(straight, packed, self._contact(point), theta, chosen)
        return Expansion(agreed.inputs - packed, agreed.doubt)

    def rows(self, point: LinearizationPoint, around: Expansion, *, changes_too: bool) -> Rows:
        """Return the expanded rows, and where asked for their changes by the constants."""
        return self._at(point, around.input_correction, around.doubt, changes_too=changes_too)

    def _at(
        self,
        point: LinearizationPoint,
        input_correction: Tensor,
        doubt: Tensor | None,
        *,
        changes_too: bool,
    ) -> Rows:
        contact = self._contact(point)
        return self._rows.rows(
            self._observed,
            input_correction,
            contact if changes_too else values_alone(contact),
            _tensor(point.values),
            point.theta * contact.column_unit[:2],
            doubt,
        )

    def _contact(self, point: LinearizationPoint) -> ContactModel:
        nominal = self._nominal
        constants = nominal.contact.constants + point.kappa @ nominal.uncertain
        return nominal.contact._replace(constants=constants)


def observed_of(blocks: Blocks) -> Observed:
    """Return the observations of a run one by one, with the slopes between neighbouring blocks."""
    per_block, signals = blocks.packed.shape[1], blocks.signals
    return Observed(
        blocks.packed.flatten(0, 1),
        blocks.wheel_rate.flatten(0, 1),
        signals.slip_rate.repeat_interleave(per_block, 0),
        signals.sinkage_rate.repeat_interleave(per_block, 0),
    )


def corrected(rover: Rover, laws: Sequence[Law], values: Sequence[float], blocks: Blocks) -> Tensor:
    """Return the packed observations [n, P] of a run without effects on sensors and drives."""
    return EffectRows(laws, rover.mass).corrected(observed_of(blocks), _tensor(values))


def _tensor(values: Sequence[float]) -> Tensor:
    return torch.tensor([list(values)], dtype=torch.float64)


class RememberedIntegrals(nn.Module):
    """The stress integrals, those of the last call where their inputs are the same.

    Many effects act elsewhere than in the contact, so that differences by their sizes need no
    other integrals.
    """

    def __init__(self) -> None:
        super().__init__()
        self._last: tuple[tuple[Tensor, ...], Tensor] | None = None

    def forward(self, inputs: ContactInputs, contact: ContactModel) -> Tensor:
        """Return the coefficients of the forces, as :class:`StressIntegrals`."""
        if inputs.exit_angle is not None:
            return _integrated(inputs, contact)
        key = (inputs.slip, inputs.sinkage, inputs.constants)
        if self._last is not None and all(map(torch.equal, self._last[0], key)):
            return self._last[1]
        forces = _integrated(inputs, contact)
        self._last = key, forces
        return forces


def _integrated(inputs: ContactInputs, contact: ContactModel) -> Tensor:
    """Integrate braked wheels apart from the others: they need twice the nodes."""
    every = inputs.expanded()
    found = torch.empty(*every.slip.shape, 3, 3, dtype=torch.float64)
    braked = every.slip < 0.0
    for chosen in (braked, ~braked):
        found[chosen] = every.wheels(chosen).coefficients(
            contact.radius, contact.width, contact.nodes
        )
    return found
