# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of one run where constants of the rover are in doubt.

They are the rows of the rover that has the constants. Slip was computed by the radius as told: it
is read as ``odometry_scale`` corrects it. Sinkage is taken as measured in metres.
"""

import dataclasses
from collections import OrderedDict

from torch import Tensor

from terrain_estimator.discovery.hypotheses.library import Hypothesis, LibraryEffect
from terrain_estimator.discovery.hypotheses.rover_doubt import (
    doubts_radius,
    radius_error,
    rover_with,
)
from terrain_estimator.discovery.hypotheses.rows import (
    Changes,
    Expansion,
    HypothesisRows,
    LinearizationPoint,
    Nominal,
    corrected,
    nominal_of,
)
from terrain_estimator.discovery.hypotheses.wheel_rows import WheelRows
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.rows import Rows
from terramechanics.vehicle.rover import Rover

REMEMBERED = 8
"""Rovers whose rows are kept: those of one evaluation and of its differences."""


class DoubtedRows:
    """The rows of one run under one hypothesis with constants of the rover in doubt.

    It has the methods of :class:`HypothesisRows` that the equations call. The first values of a
    point are those of the constants.
    """

    def __init__(self, nominal: Nominal, blocks: Blocks, hypothesis: Hypothesis) -> None:
        """Take the run; ``hypothesis`` has the constants in doubt."""
        self._told, self._hypothesis = nominal.of(blocks), hypothesis
        self._blocks = dataclasses.replace(blocks, soil=None)  # that of the nominal model
        self._on: OrderedDict[tuple[float, ...], HypothesisRows] = OrderedDict()

    def expansion(self, point: LinearizationPoint, chosen: Tensor) -> Expansion:
        """Return the inputs at which the ``chosen`` rows agree best."""
        rows, own = self._at(point)
        return rows.expansion(own, chosen)

    def rows(self, point: LinearizationPoint, around: Expansion) -> Rows:
        """Return the expanded rows."""
        rows, own = self._at(point)
        return rows.rows(own, around)

    def corrected(self, point: LinearizationPoint, around: Expansion, error: Tensor) -> Tensor:
        """Return rows less targets [n, R] at inputs with the ``error`` [n, E] of each source."""
        rows, own = self._at(point)
        return rows.corrected(own, around, error)

    def rows_and_changes(
        self, point: LinearizationPoint, around: Expansion
    ) -> tuple[Rows, Changes]:
        """Return the expanded rows and their changes by the soil constants."""
        rows, own = self._at(point)
        return rows.rows_and_changes(own, around)

    def _at(self, point: LinearizationPoint) -> tuple[HypothesisRows, LinearizationPoint]:
        """Return the rows on the rover of a point, and the point without its constants."""
        count = len(self._hypothesis.doubt)
        values = point.values[:count]
        if values not in self._on:
            rover = rover_with(self._told.rover, self._hypothesis.doubt, values)
            laws = self._hypothesis.laws(rover)
            self._on[values] = HypothesisRows(_on_rover(self._told, rover), self._read(rover), laws)
            if len(self._on) > REMEMBERED:
                self._on.popitem(last=False)
        self._on.move_to_end(values)
        return self._on[values], dataclasses.replace(point, values=point.values[count:])

    def _read(self, rover: Rover) -> Blocks:
        """Return the run with slip by the radius of ``rover``."""
        if not doubts_radius(self._hypothesis.doubt):
            return self._blocks
        scale = LibraryEffect("odometry_scale").on(rover)
        values = [radius_error(self._told.rover, rover), *(0.0 for _ in scale.extra)]
        packed = corrected(rover, [scale], values, self._blocks)
        return dataclasses.replace(self._blocks, packed=packed.view_as(self._blocks.packed))


def _on_rover(told: Nominal, rover: Rover) -> Nominal:
    """Return the nominal model on another rover, with the soil constants' deviations as told."""
    there = nominal_of(rover, told.soil, told.prior).contact
    contact = told.contact._replace(
        geometry=there.geometry,
        body_scale=there.body_scale,
        radius=there.radius,
        width=there.width,
    )
    return dataclasses.replace(told, rover=rover, contact=contact, revised=())


def rows_of(
    nominal: Nominal, blocks: Blocks, hypothesis: Hypothesis
) -> HypothesisRows | WheelRows | DoubtedRows:
    """Return the rows of a run under a hypothesis, by axle or by wheel."""
    if hypothesis.doubt:
        return DoubtedRows(nominal, blocks, hypothesis)
    kind = HypothesisRows if nominal.places is None else WheelRows
    return kind(nominal, blocks, hypothesis.laws(nominal.rover))
