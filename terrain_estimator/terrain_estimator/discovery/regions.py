# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Where a row may disagree: regions of each signal, as columns of the rows of every run.

A region is everything above or below a quantile of the signal over all runs, or the whole of it with a disagreement in
proportion to the signal. Signals are those of the neighbouring seconds (see ``runs.Signals``), so that their noise is not that of
the residual; rim speed and acceleration come from encoders.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.equations import Unknowns
from terrain_estimator.discovery.flexible import in_row
from terrain_estimator.discovery.physics import Nominal
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.rows import row_names
from terramechanics.contact import wheel_forces

ABOVE, BELOW = (0.5, 0.75, 0.9), (0.1, 0.25, 0.5)
"""Shares of all seconds at which a region may begin or end."""
FEWEST = 5
"""Seconds inside and outside of a region, of all runs together."""
AXLES = ("front", "middle", "rear")


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal over the blocks of every run."""

    name: str
    unit: str
    values: tuple[Tensor, ...]  # [B] of each run


@dataclass(frozen=True, slots=True)
class Region:
    """One column: a row that disagrees in a region of a signal."""

    row: str
    signal: str
    words: str  # such as "above 3.2 deg uphill"
    scale: float  # [1] of the coefficient, to be what the row disagrees by there


@dataclass(frozen=True, slots=True)
class Regions:
    """All columns of all runs."""

    names: tuple[Region, ...]  # K
    columns: tuple[Tensor, ...]  # [B, Q, K] of each run


def regions(nominal: Nominal, runs: Sequence[Blocks], fitted: Sequence[Unknowns]) -> Regions:
    """Every region of every signal in every row; ``fitted`` says what the axles carry."""
    axles = nominal.rover.axles
    body, wheels = signals(nominal, runs, fitted)
    names: list[Region] = []
    columns: list[list[Tensor]] = [[] for _ in runs]
    for row, name in enumerate(row_names(axles)):
        own = wheels[row - 2] if name.startswith("torque") else body
        everywhere = (
            Region(name, "wheel", f"{axle_name(row - 2, axles)} wheels", 1.0)
            if own is not body
            else Region(name, "none", "everywhere", 1.0)
        )
        always = [torch.ones(run.packed.shape[0], dtype=torch.float64) for run in runs]
        units = [in_row(one, row, run) for one, run in zip(always, runs, strict=True)]
        shapes = [(everywhere, always)]
        shapes += [shape for signal in own.values() for shape in _shapes(name, signal)]
        for region, values in shapes:
            names.append(region)
            for column, value, unit in zip(columns, values, units, strict=True):
                column.append(value.unsqueeze(1) * unit)
    return Regions(tuple(names), tuple(torch.stack(column, -1) for column in columns))


def signals(
    nominal: Nominal, runs: Sequence[Blocks], fitted: Sequence[Unknowns]
) -> tuple[Mapping[str, Signal], list[Mapping[str, Signal]]]:
    """Signals of the body's rows and those of each axle's torque row, by name."""
    axles = nominal.rover.axles
    every = [run.signals for run in runs]
    loads = [_loads(nominal, run, unknowns) for run, unknowns in zip(runs, fitted, strict=True)]
    gains = [_gain(run) for run in runs]
    shared = {
        "slope": Signal("slope", "deg", tuple(torch.rad2deg(each.pitch[:, 0]) for each in every)),
        "time": Signal("time", "s", tuple(each.time[:, 0] for each in every)),
        "distance": Signal("distance", "m", tuple(each.distance[:, 0] for each in every)),
        "acceleration": Signal("acceleration", "m/s^2", tuple(gain.mean(1) for gain in gains)),
    }
    kinds = {
        "speed": ("m/s", [each.speed for each in every]),
        "slip": ("", [each.slip for each in every]),
        "sinkage": ("mm", [1e3 * each.sinkage for each in every]),
        "load": ("N", loads),
    }
    own = [
        {kind: Signal(kind, unit, tuple(value[:, axle] for value in values)) for kind, (unit, values) in kinds.items()}
        for axle in range(axles)
    ]
    mean = {kind: Signal(kind, unit, tuple(value.mean(1) for value in values)) for kind, (unit, values) in kinds.items() if kind != "load"}
    single = {
        f"{kind} of the {axle_name(axle, axles)} wheels": Signal(f"{kind} of the {axle_name(axle, axles)} wheels", unit, each.values)
        for axle in range(axles)
        for kind, each in own[axle].items()
        for unit in (each.unit,)
        if kind in ("slip", "sinkage", "load")
    }
    return shared | mean | single, [shared | each for each in own]


def axle_name(axle: int, axles: int) -> str:
    """``front``, ``middle``, ``rear`` for three axles."""
    return AXLES[axle] if axles == len(AXLES) else f"axle {axle + 1}"


def _loads(nominal: Nominal, run: Blocks, fitted: Unknowns) -> Tensor:
    """Normal force of one wheel of each axle [B, A] [N] by slips and sinkages of the neighbouring seconds."""
    contact = nominal.contact
    constants = contact.constants + fitted.kappa @ nominal.uncertain
    forces = wheel_forces(run.signals.slip, run.signals.sinkage, constants, contact.radius, contact.width, contact.nodes)
    theta = torch.cat([fitted.theta * contact.column_unit[:2], torch.ones(1, dtype=torch.float64)])
    return forces[..., 0, :] @ theta


def _gain(run: Blocks) -> Tensor:
    """Acceleration of the rims [B, A] [m/s^2] between the neighbouring blocks, from encoders."""
    time, speed = run.signals.time, run.signals.speed
    after, before = torch.cat([speed[1:], speed[-1:]]), torch.cat([speed[:1], speed[:-1]])
    passed = torch.cat([time[1:], time[-1:]]) - torch.cat([time[:1], time[:-1]])
    return (after - before) / passed


def _shapes(row: str, signal: Signal) -> list[tuple[Region, list[Tensor]]]:
    """The regions of one signal, with their values in every run."""
    every = torch.cat(signal.values)
    low, high = (float(torch.quantile(every, share)) for share in (0.1, 0.9))
    if not high - low > 1e-9 * max(abs(high), abs(low)):
        return []
    found: list[tuple[Region, list[Tensor]]] = []
    for above, shares in ((True, ABOVE), (False, BELOW)):
        for end in dict.fromkeys(_rounded(float(torch.quantile(every, share)), high - low) for share in shares):
            inside = [((value > end) if above else (value < end)).to(torch.float64) for value in signal.values]
            count = float(torch.cat(inside).sum())
            if FEWEST <= count <= every.shape[0] - FEWEST:
                found.append((Region(row, signal.name, _words(signal, end, above=above), 1.0), inside))
    middle, change = 0.5 * (low + high), high - low
    ends = f"{_number(low, change)} to {_number(high, change)} {signal.unit}".rstrip()
    found.append((Region(row, signal.name, f"in proportion, from {ends}", 1.0), [(value - middle) / change for value in signal.values]))
    return found


def _words(signal: Signal, end: float, *, above: bool) -> str:
    side = "above" if above else "below"
    if signal.name == "slope" and abs(end) > 0.0 and above == (end > 0.0):
        return f"above {abs(end):g} deg {'uphill' if above else 'downhill'}"
    return f"{side} {end:g} {signal.unit}".rstrip()


def _rounded(value: float, spread: float) -> float:
    """To about a hundredth of the spread, so that a region is what its words say."""
    digits = 1 - math.floor(math.log10(spread))
    return round(value, digits)


def _number(value: float, spread: float) -> str:
    return f"{_rounded(value, spread):g}"
