# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of one run under a hypothesis, by the row building that models share."""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import NamedTuple

import torch
from torch import Tensor, nn

from rover_parameters.records import ConfigError
from terrain_estimator.discovery.hypotheses.rover_doubt import CERTAIN, RoverDoubt
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.effect_rows import EffectRows, Observed
from terrain_estimator.model.packing import PackedView
from terrain_estimator.model.physics import uncertain_constants
from terrain_estimator.model.physics_of_wheels import physics_by_wheel
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terrain_estimator.model.row_names import row_names, row_names_by_wheel
from terrain_estimator.model.rows import (
    MOMENT_VARIANCE,
    PA_PER_UNIT,
    ContactModel,
    Forces,
    Frame,
    Rows,
    frame_of,
    measured_forces,
    places,
    read_forces,
    rows_of_forces,
    usable_wheels,
    values_alone,
    varied_inputs,
)
from terrain_estimator.model.stencil import OWN, stencil
from terramechanics.contact.laws import keeps_ruts
from terramechanics.contact.scm import Rut
from terramechanics.contact.stresses import quadrature
from terramechanics.effects.law import Law
from terramechanics.simulation.plant import ContactInputs
from terramechanics.terrain.soil import LINEAR_STRESS, SCM, WONG_REECE, Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import geometry_of
from terramechanics.vehicle.wheel_places import WheelPlaces

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
    revised: tuple[tuple[Soil, Soil], ...] = ()
    """Soils as told, and the soils that runs on them have."""
    places: WheelPlaces | None = None  # where wheels are taken one by one; None: by axle
    doubt: RoverDoubt = CERTAIN  # constants of the rover file that are not exact

    @property
    def wheels(self) -> tuple[str, ...]:
        """Names of the wheels that are taken one by one; empty: the rows are by axle."""
        return () if self.places is None else self.places.wheels(self.rover)

    @property
    def stations(self) -> int:
        """Number of values of a quantity in an observation: one per axle, or per wheel."""
        return len(self.wheels) or self.rover.axles

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the rows, in their order."""
        if self.places is None:
            return row_names(self.rover.axles)
        return row_names_by_wheel(self.stations, len(self.rover.suspension))

    def soil_of(self, told: Soil) -> Soil:
        """Return the soil that runs on a soil as told have."""
        return dict(self.revised).get(told, told)

    def of(self, run: Blocks) -> "Nominal":
        """Return the nominal model on the soil of a run."""
        soil = self.soil_of(run.soil or self.soil)
        if soil == self.soil and not self.revised:
            return self
        return nominal_of(self.rover, soil, self.prior, self.places)


@lru_cache(maxsize=32)
def nominal_of(
    rover: Rover, soil: Soil, prior: Prior = DEFAULT_PRIOR, places: WheelPlaces | None = None
) -> Nominal:
    """Return the nominal model; ``prior`` is that of the model which may lack an effect.

    ``places`` are given where wheels are taken one by one. Raises ConfigError for a rover that is
    not planar without them, and where effects are not known for the soil's contact law.
    """
    if soil.law == LINEAR_STRESS:
        raise ConfigError(
            f"soil {soil.name}: law {LINEAR_STRESS}: the search for effects knows {WONG_REECE} and"
            f" {SCM} alone"
        )
    if places is not None:
        nominal = physics_by_wheel(
            rover, places, soil.constants().unsqueeze(0), prior.constants_sd
        ).nominal
        contact, uncertain = nominal.nominal_contact(), nominal.uncertain[0]
        return Nominal(rover, soil, contact, uncertain, prior, places=places)
    rover.check_planar()
    constants = soil.constants().unsqueeze(0)
    uncertain = uncertain_constants(constants, prior.constants_sd, rover.wheel_width)[0]
    stand_in = torch.tensor(
        [0.1, 0.01, 0.01 * rover.wheel_radius, 1e-3 * rover.wheel_radius, 0.0, 0.0, 0.0, 0.0],
        dtype=torch.float64,
    )
    wheels, weight = rover.wheels_per_axle, rover.mass * rover.gravity
    moments = [wheels / (weight * (rover.axle_x[0] - rover.axle_x[-1]))] * (
        1 + len(rover.suspension)
    )
    contact = ContactModel(
        constants=soil.constants(),
        varied=torch.cat([torch.zeros(1, 6, dtype=torch.float64), 1e-3 * uncertain]),
        stencil=stencil(uncertain.shape[0]),
        nodes=quadrature(_POINTS),
        column_unit=torch.tensor([PA_PER_UNIT, 1.0, 1.0], dtype=torch.float64),
        geometry=geometry_of(rover),
        body_scale=torch.tensor(
            [wheels / rover.mass, wheels / weight, *moments], dtype=torch.float64
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


class Changes(NamedTuple):
    """The change of n observations' rows for one prior deviation of each of M soil constants."""

    levers: Tensor  # [n, A, 2, R, 3] as of :class:`Frame`
    forces: Forces  # [M, n, A, 3] at c and tan phi

    def at(self, error: Tensor) -> Tensor:
        """Return the changes [M, n, R] at inputs with the ``error`` [n, E] of each source."""
        faster, deeper, turned, _ = error.unsqueeze(-1).split_with_sizes(
            [*[self.levers.shape[1]] * 3, 1], 1
        )
        values, by_slip, by_sinkage = self.forces
        acting = values + faster * by_slip + deeper * by_sinkage
        both = torch.stack([acting, turned * values], 3)  # [M, n, A, 2, 3]
        levers = self.levers.permute(0, 3, 1, 2, 4).flatten(2)
        return (levers @ both.permute(1, 2, 3, 4, 0).flatten(1, 3)).permute(2, 0, 1)


@dataclass(frozen=True, slots=True)
class _Read:
    """The forces of wheels, and what they depend on."""

    given: tuple[Tensor, ...]
    doubt: Tensor | None
    forces: Forces

    def holds(self, given: tuple[Tensor, ...], doubt: Tensor | None) -> bool:
        """Return whether these are the forces for what is ``given``, in this ``doubt``."""
        return doubt is self.doubt and all(map(torch.equal, self.given, given))


class HypothesisRows:
    """The rows of one run under one hypothesis, at any point."""

    def __init__(self, nominal: Nominal, blocks: Blocks, laws: Sequence[Law]) -> None:
        """Prepare what does not depend on the point; ``laws`` are those of the hypothesis."""
        self._nominal, self._observed = nominal.of(blocks), observed_of(blocks)
        self._rows = EffectRows(laws, nominal.rover.mass, _integrals(self._nominal.soil.law))
        acting = [acts_in_forces(law) for law in laws for _ in range(law.count)]
        self._acting = torch.tensor([acting], dtype=torch.bool)  # by value
        self._last: _Read | None = None

    def expansion(self, point: LinearizationPoint, chosen: Tensor) -> Expansion:
        """Return the inputs at which the ``chosen`` rows agree best, see :func:`agreement`."""
        packed = self._rows.corrected(self._observed, _tensor(point.values))
        here, contact = torch.zeros_like(packed), self._contact(point)
        # without a doubt nothing is read from the last input, which is for the mixed difference
        straight = rows_of_forces(*self._measured(point, values_alone(contact, OWN - 1), here))
        theta = torch.cat([point.theta, torch.ones_like(point.theta[:1])])
        agreed = agreement(straight, packed, contact, theta, chosen)
        return Expansion(agreed.inputs - packed, agreed.doubt)

    def rows(self, point: LinearizationPoint, around: Expansion) -> Rows:
        """Return the expanded rows."""
        contact = values_alone(self._contact(point))
        return rows_of_forces(*self._measured(point, contact, *around))

    def corrected(self, point: LinearizationPoint, around: Expansion, error: Tensor) -> Tensor:
        """Return rows less targets [n, R] at inputs with the ``error`` [n, E] of each source.

        What :meth:`rows` gives for them too, in a third of the time.
        """
        frame, forces = self._measured(point, values_alone(self._contact(point)), *around)
        theta = torch.cat([point.theta, torch.ones_like(point.theta[:1])])
        acting = Changes(frame.levers, Forces(*(each @ theta for each in forces)))
        return acting.at(error)[0] + frame.tilt * error[:, -1:] - frame.target

    def rows_and_changes(
        self, point: LinearizationPoint, around: Expansion
    ) -> tuple[Rows, Changes]:
        """Return the expanded rows and their changes by the soil constants."""
        frame, forces = self._measured(point, self._contact(point), *around)
        theta = torch.cat([point.theta, torch.ones_like(point.theta[:1])])
        rows = rows_of_forces(frame, Forces(*(each[:1] for each in forces)))
        return rows, Changes(frame.levers, Forces(*(each[1:] @ theta for each in forces)))

    def _measured(
        self,
        point: LinearizationPoint,
        contact: ContactModel,
        input_correction: Tensor,
        doubt: Tensor | None = None,
    ) -> tuple[Frame, Forces]:
        """Return what :meth:`EffectRows.measured` does, with a frame that may be remembered."""
        values, observed = _tensor(point.values), self._observed
        packed, loaded = (
            self._rows.corrected(observed, values),
            self._rows.loaded(contact, values),
        )
        frame = _frame(packed, loaded)
        place = places(packed + input_correction, frame, loaded)
        read = self._read(point, place, loaded, values, doubt)
        return frame, measured_forces(frame, place, read)

    def _read(
        self,
        point: LinearizationPoint,
        place: PackedView,
        contact: ContactModel,
        values: Tensor,
        doubt: Tensor | None,
    ) -> Forces:
        """Return the forces at a ``place``, the latest ones where nothing of theirs has changed.

        Differences by the size of an effect on sensors, drives or the body need no other forces.
        """
        given = (
            *(place.slip, place.sinkage, place.slip_sd, place.sinkage_sd, contact.stencil.moves),
            *(contact.constants, point.theta, values[self._acting]),
        )
        if self._last is not None and self._last.holds(given, doubt):
            return self._last.forces
        varied = varied_inputs(place, contact)
        strength = point.theta * contact.column_unit[:2]
        ruts = self._rows.ruts(place.slip, place.sinkage, self._observed.rut, contact)
        inputs = ContactInputs(
            varied.slip, varied.sinkage, varied.constants, strength.view(1, 1, 2), rut=ruts
        )
        forces = self._rows.forces(inputs, self._observed.wheel_rate, contact, values)
        read = read_forces(forces, varied.scale, contact, doubt)
        self._last = _Read(given, doubt, read)
        return read

    def _contact(self, point: LinearizationPoint) -> ContactModel:
        nominal = self._nominal
        constants = nominal.contact.constants + point.kappa @ nominal.uncertain
        return nominal.contact._replace(constants=constants)


def acts_in_forces(law: Law) -> bool:
    """Return whether a law changes the forces on wheels at a given place."""
    own, none = type(law), Law
    return (own.contact, own.stresses, own.under_load, own.added_force) != (
        none.contact,
        none.stresses,
        none.under_load,
        none.added_force,
    )


def observed_of(blocks: Blocks) -> Observed:
    """Return the observations of a run one by one, with the slopes between neighbouring blocks."""
    per_block, signals = blocks.packed.shape[1], blocks.signals
    return Observed(
        blocks.packed.flatten(0, 1),
        blocks.wheel_rate.flatten(0, 1),
        signals.slip_rate.repeat_interleave(per_block, 0),
        signals.sinkage_rate.repeat_interleave(per_block, 0),
        None if blocks.ruts is None else Rut(*(part.flatten(0, 1) for part in blocks.ruts)),
    )


def corrected(rover: Rover, laws: Sequence[Law], values: Sequence[float], blocks: Blocks) -> Tensor:
    """Return the packed observations [n, P] of a run without effects on sensors and drives."""
    return EffectRows(laws, rover.mass).corrected(observed_of(blocks), _tensor(values))


def _tensor(values: Sequence[float]) -> Tensor:
    return torch.tensor([list(values)], dtype=torch.float64)


REMEMBERED = 48_000_000
"""[bytes] of integrals that a process remembers: a dozen one-minute runs at a few points."""


class RememberedIntegrals(nn.Module):
    """The stress integrals, those of an earlier call where their inputs are the same.

    Many effects act elsewhere than in the contact, so that differences by their sizes need no other
    integrals, nor do other such effects at the same ground.
    """

    def __init__(self, law: str = WONG_REECE) -> None:
        """``law`` is the contact law of the soil."""
        super().__init__()
        self._law, self.keeps_ruts = law, keeps_ruts(law)
        self._known: OrderedDict[tuple[object, ...], Tensor] = OrderedDict()
        self._bytes = 0

    def forward(self, inputs: ContactInputs, contact: ContactModel) -> Tensor:
        """Return the coefficients of the forces, as :class:`StressIntegrals`."""
        if inputs.exit_angle is not None:
            return _integrated(inputs, contact, self._law)
        rut = () if inputs.rut is None else tuple(inputs.rut)
        parts = (inputs.slip, inputs.sinkage, inputs.constants, contact.nodes, *rut)
        key = (contact.radius, contact.width, *((each.shape, _bytes(each)) for each in parts))
        if key in self._known:
            self._known.move_to_end(key)
            return self._known[key]
        forces = self._known[key] = _integrated(inputs, contact, self._law)
        self._bytes += forces.nbytes
        while self._bytes > REMEMBERED and len(self._known) > 1:
            self._bytes -= self._known.popitem(last=False)[1].nbytes
        return forces


FRAMES = 24
"""Frames that a process remembers, about 1 MB for a minute."""
_FRAMES: OrderedDict[tuple[object, ...], Frame] = OrderedDict()


def _frame(packed: Tensor, contact: ContactModel) -> Frame:
    """Return the frame of observations [n, P], an earlier one where its inputs are the same.

    Effects in the contact leave it alone, and so do c, tan phi and soil constants, but for wheels
    that are no longer usable.
    """
    body = contact.geometry
    placed = (body.axle_x, body.centre, body.pivot, body.carried, contact.body_scale)
    parts = (packed, usable_wheels(packed, contact), *placed)
    key = (contact.gravity, contact.radius, *(_bytes(each) for each in parts))
    if key not in _FRAMES:
        _FRAMES[key] = frame_of(packed, contact)
        if len(_FRAMES) > FRAMES:
            _FRAMES.popitem(last=False)
    _FRAMES.move_to_end(key)
    return _FRAMES[key]


@cache
def _integrals(law: str) -> RememberedIntegrals:
    """Return the integrals that this process remembers of one contact law."""
    return RememberedIntegrals(law)


def _bytes(values: Tensor) -> bytes:
    return values.numpy().tobytes()


def _integrated(inputs: ContactInputs, contact: ContactModel, law: str) -> Tensor:
    """Integrate braked wheels apart from the others: they need twice the nodes."""
    braked = inputs.slip < 0.0
    if not bool(braked.any()):
        return inputs.coefficients(contact.radius, contact.width, contact.nodes, law)
    every = inputs.expanded()
    found = torch.empty(*every.slip.shape, 3, 3, dtype=torch.float64)
    braked = every.slip < 0.0
    for chosen in (braked, ~braked):
        found[chosen] = every.wheels(chosen).coefficients(
            contact.radius, contact.width, contact.nodes, law
        )
    return found
