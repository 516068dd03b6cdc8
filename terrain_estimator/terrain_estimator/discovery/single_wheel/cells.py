# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Steady states of one wheel, measured and modelled by terramechanics."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from rover_parameters.records import number
from terramechanics.contact.sinkage import WheelGround, equilibrium_sinkage
from terramechanics.contact.stresses import in_range
from terramechanics.simulation.plant import Effect, Plant, Situation
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

SAME_SLIP, SAME_LOAD, SAME_ANGLE = 0.02, 1.5, math.radians(1.0)
"""[1], [1], [rad] Limits of replicates: slip difference, load ratio, slip-angle difference."""
POINTS = 6
LARGEST = 2.0
"""[m] Largest wheel of a testbed; a larger number is in another unit."""
SLIP_STEP = 1e-4
"""[1] Slip by which rows are differenced."""
DATUM_SD = 0.005
"""[m] of the common offset of all sinkages."""
ROWS = ("sinkage", "drawbar_pull", "lateral_force", "torque")
UNITS = ("m", "N", "N", "N m")
"""Rows of a cell, and their units."""


@dataclass(frozen=True, slots=True)
class TestbedWheel:
    """A wheel on a testbed."""

    name: str
    radius: float = number("radius of the rim", "m", 0.0, LARGEST, exclusive=True)
    width: float = number("width", "m", 0.0, LARGEST, exclusive=True)
    lug_height: float = number("height of lugs above the rim", "m", 0.0, LARGEST, default=0.0)


@dataclass(frozen=True, slots=True)
class Row:
    """One steady state."""

    table: str
    trial: str
    slip: float  # [1] 1 - V / (r w), V along the wheel's heading
    load: float  # [N]
    wheel_rate: float  # [rad/s]
    sinkage: float  # [m]
    drawbar_pull: float  # [N]
    slip_angle: float = 0.0  # [rad] positive where the wheel moves to the right of its heading
    # [N] on the wheel, positive to the left; NaN straight ahead, where the model has none
    lateral_force: float = math.nan
    torque: float = math.nan  # [N m] that drives the wheel; NaN where it was not measured


@dataclass(frozen=True, slots=True)
class Cells:
    """B settings, each with the mean of its replicates, which share the model's error."""

    table: tuple[str, ...]
    slip: Tensor  # [B]
    load: Tensor  # [B] [N]
    wheel_rate: Tensor  # [B] [rad/s]
    slip_angle: Tensor  # [B] [rad]
    measured: Tensor  # [B, R] in the order of ROWS, NaN where it was not measured
    replicates: tuple[int, ...]
    acts: Tensor  # [B] bool: where the effects that are looked for may act

    @property
    def seen(self) -> Tensor:
        """Rows that were measured, [B, R] bool."""
        return ~self.measured.isnan()

    def part(self, index: Sequence[int]) -> "Cells":
        """Return some of the cells."""
        of = torch.tensor(list(index), dtype=torch.long)
        return Cells(
            tuple(self.table[k] for k in index),
            self.slip[of],
            self.load[of],
            self.wheel_rate[of],
            self.slip_angle[of],
            self.measured[of],
            tuple(self.replicates[k] for k in index),
            self.acts[of],
        )


def cells_of(rows: Sequence[Row], reference: frozenset[str] = frozenset()) -> Cells:
    """Put replicates together.

    Effects that are looked for do not act in the tables of ``reference``.
    """
    groups: list[list[Row]] = []
    for row in rows:
        near = next((group for group in groups if _alike(group[0], row)), None)
        if near is None:
            groups.append([row])
        else:
            near.append(row)

    def mean(name: str) -> Tensor:
        return torch.tensor(
            [math.fsum(getattr(row, name) for row in group) / len(group) for group in groups],
            dtype=torch.float64,
        )

    tables = tuple(group[0].table for group in groups)
    acts = torch.tensor([table not in reference for table in tables])
    measured = torch.stack([mean(name) for name in ROWS], 1)
    return Cells(
        tables,
        mean("slip"),
        mean("load"),
        mean("wheel_rate"),
        mean("slip_angle"),
        measured,
        tuple(map(len, groups)),
        acts,
    )


def _alike(first: Row, second: Row) -> bool:
    heavier, lighter = max(first.load, second.load), min(first.load, second.load)
    turned = abs(first.slip_angle - second.slip_angle) >= SAME_ANGLE
    return (
        first.table == second.table
        and not turned
        and abs(first.slip - second.slip) < SAME_SLIP
        and heavier < SAME_LOAD * lighter
    )


class SensorError(NamedTuple):
    """One unknown error of a sensor, the same in all tables."""

    row: int  # of ROWS
    sd: float  # of a zero in the unit of its row, of a gain [1]
    is_gain: bool

    @property
    def name(self) -> str:
        """What a finding calls it."""
        return f"{'gain' if self.is_gain else 'zero'} of {ROWS[self.row]}"


@dataclass(frozen=True, slots=True)
class Rig:
    """The nominal wheel and soil."""

    rover: Rover  # of which the wheel alone counts
    soil: Soil
    # [1] relative deviations of n, k_c / b + k_phi, K, c1 and c2
    constants_sd: tuple[float, ...]
    repeatability: tuple[float, ...]  # [R] deviations of a cell
    offset_sd: tuple[float, ...] = (DATUM_SD, 0.0, 0.0, 0.0)
    """[R] Deviation of each sensor's zero, the same in all tables; 0: the zero is known."""
    reading_sd: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """[R] Errors of reading, as of a figure that was traced, beside repeatability."""
    slip_sd: float = 0.0
    """[1] Error of reading the slip, which all rows of a cell share."""
    gain_sd: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """[R] Relative deviation of each sensor's gain, the same in all tables; 0: it is known."""

    @property
    def deviations(self) -> tuple[float, ...]:
        """Repeatability and errors of reading together, [R]."""
        return tuple(map(math.hypot, self.repeatability, self.reading_sd))

    @property
    def sensor_errors(self) -> tuple[SensorError, ...]:
        """The S errors of sensors that are not known, gains first."""
        return tuple(
            SensorError(row, sd, is_gain)
            for is_gain, sds in ((True, self.gain_sd), (False, self.offset_sd))
            for row, sd in enumerate(sds)
            if sd > 0.0
        )

    def read(self, states: Tensor, errors: Tensor) -> Tensor:
        """Return what sensors with ``errors`` [V, S] show of states [V, B, R]."""
        shown = states.clone()
        for place, error in enumerate(self.sensor_errors):
            value = errors[:, place : place + 1]
            shown[..., error.row] += shown[..., error.row] * value if error.is_gain else value
        return shown

    def slip_errors(self, cells: Cells, rows: Callable[[Cells], Tensor]) -> Tensor:
        """Return the covariance [R B, R B], cell by cell, that the error of slip gives to rows.

        In ``deviations``; ``rows`` [B, R] of cells are linearised.
        """
        count = len(ROWS) * len(cells.slip)
        if self.slip_sd == 0.0:
            return torch.zeros(count, count, dtype=torch.float64)
        moved = dataclasses.replace(cells, slip=cells.slip + SLIP_STEP)
        scale = self.slip_sd / SLIP_STEP / torch.tensor(self.deviations, dtype=torch.float64)
        slopes = (rows(moved) - rows(cells)) * scale
        blocks = slopes.unsqueeze(2) * slopes.unsqueeze(1)
        return torch.block_diag(*blocks)  # type: ignore[no-untyped-call]

    def usable(self, slip: float, sinkage: float) -> bool:
        """Return whether the contact model describes this state at all."""
        values = torch.tensor([slip, max(sinkage, 1e-6)], dtype=torch.float64)
        return bool(in_range(values[0], values[1], self.soil.constants(), self.rover.wheel_radius))

    def states(
        self,
        cells: Cells,
        strength: Tensor,
        constants: Tensor,
        effects: Sequence[Effect],
        start: Tensor | None = None,
    ) -> Tensor:
        """Return rows of cells, [V, B, R], for V soils.

        ``strength`` [V, 2] has c in Pa; ``constants`` are [V, 6]. ``effects`` have one set of
        values, or V B. The search for the sinkages begins at ``start`` [B] [m].
        """
        several, count = strength.shape[0], cells.slip.shape[0]
        slip, load, rate = (
            each.repeat(several).unsqueeze(1) for each in (cells.slip, cells.load, cells.wheel_rate)
        )
        nowhere = torch.full_like(slip, math.nan)
        where = Situation(
            rover=self.rover,
            time=math.nan,
            episode=torch.arange(several * count),
            place=nowhere,
            rate=rate,
            velocity=nowhere[:, 0],
        )
        soil, ground = (
            each.repeat_interleave(count, 0).unsqueeze(1) for each in (constants, strength)
        )
        wheel = WheelGround.of(self.rover, soil, ground, POINTS, Plant(effects), where)
        if bool(cells.slip_angle.any()):
            wheel = dataclasses.replace(
                wheel, slip_angle=cells.slip_angle.repeat(several).unsqueeze(1)
            )
        if start is not None:
            start = start.repeat(several).unsqueeze(1)
        depth = equilibrium_sinkage(wheel, slip, load, start)
        forces = wheel.forces(slip, depth)
        lateral = forces[..., 3] if wheel.slip_angle is not None else torch.zeros_like(depth)
        return torch.stack([depth, forces[..., 1], lateral, forces[..., 2]], -1).view(
            several, count, len(ROWS)
        )


def wheel_alone(rover: Rover, radius: float, width: float) -> Rover:
    """Return a rover with that wheel, whose radius effects need."""
    return dataclasses.replace(rover, wheel_radius=radius, wheel_width=width)
