# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Regions of each signal, as columns of the rows of every run.

A region is everything above or below a quantile of the signal over all runs, or the whole of it
with a disagreement in proportion to the signal. Signals are those of the neighbouring seconds (see
``runs.Signals``), so that their noise is not that of the residual; rim speed and acceleration come
from encoders. Where noise lasts longer than a second it is still correlated with that of the
neighbours, and moves a row together with a signal: ``Region.alike`` bounds by how much. A signal
that is mostly noise, such as the slope of level ground, is not used.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.leftover.flexible import in_row
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.body_motion import body_motion
from terrain_estimator.model.packing import view_of
from terramechanics.contact.laws import contact_law
from terramechanics.simulation.sample import SLOWEST

ABOVE, BELOW = (0.5, 0.75, 0.9), (0.1, 0.25, 0.5)
"""Shares of all seconds at which a region may begin or end."""
FEWEST = 5
"""Seconds inside and outside of a region, of all runs together."""
AXLES = {2: ("front", "rear"), 3: ("front", "middle", "rear")}
"""Names of the axles, by their number."""


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal over the blocks of every run."""

    name: str
    unit: str
    values: tuple[Tensor, ...]  # [B] of each run
    noise: tuple["Jitter", ...] = ()  # of each run; none for encoders and clocks

    @property
    def mostly_noise(self) -> bool:
        """Return whether it varies by less than twice its noise."""
        return bool(self.noise) and self._share > LARGEST_NOISE

    @property
    def _share(self) -> float:
        power = torch.tensor([each.sd**2 for each in self.noise], dtype=torch.float64).mean()
        return float(power.sqrt() / torch.cat(self.values).std().clamp(min=1e-12))

    @property
    def alike(self) -> float:
        """Return a bound of the correlation between the noise of a row and this signal."""
        return (
            max((each.alike for each in self.noise), default=0.0) * self._share
            if self.noise
            else 0.0
        )


@dataclass(frozen=True, slots=True)
class Jitter:
    """Noise of a signal, a mean over the neighbouring blocks."""

    sd: float
    alike: float  # [1] correlation with the noise of the block itself


@dataclass(frozen=True, slots=True)
class Region:
    """One column: a row that disagrees in a region of a signal."""

    row: str
    signal: str
    words: str  # such as "above 3.2 deg uphill"
    alike: float  # [1] bound of the correlation between the noise of the row and the signal


@dataclass(frozen=True, slots=True)
class Regions:
    """All columns of all runs."""

    names: tuple[Region, ...]  # K
    columns: tuple[Tensor, ...]  # [B, Q, K] of each run


def regions(nominal: Nominal, runs: Sequence[Blocks], fitted: Sequence[Unknowns]) -> Regions:
    """Return every region of every signal in every row, at the loads of a ``fitted`` candidate."""
    body, wheels = signals(nominal, runs, fitted)
    names: list[Region] = []
    columns: list[list[Tensor]] = [[] for _ in runs]
    for row, name in enumerate(nominal.row_names):
        own = wheels[row - 2] if name.startswith("torque") else body
        everywhere = (
            Region(name, "wheel", wheels_name(row - 2, nominal), 0.0)
            if own is not body
            else Region(name, "none", "everywhere", 0.0)
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
    """Return the signals of the body's rows and those of each axle's torque row, by name.

    Wheels that are taken one by one have a slip angle and no load, which depends on more than slip
    and sinkage there.
    """
    axles = nominal.stations
    every = [run.signals for run in runs]
    gains = [_gain(run) for run in runs]
    level = tuple(
        _jitter(view.pitch, view.pitch_sd, math.degrees(1.0))
        for view in (view_of(run.packed, axles) for run in runs)
    )
    shared = {
        "slope": Signal(
            "slope", "deg", tuple(torch.rad2deg(each.pitch[:, 0]) for each in every), level
        ),
        "time": Signal("time", "s", tuple(each.time[:, 0] for each in every)),
        "distance": Signal("distance", "m", tuple(each.distance[:, 0] for each in every)),
        "acceleration": Signal("acceleration", "m/s^2", tuple(gain.mean(1) for gain in gains)),
    }
    own = [
        {
            "speed": Signal("speed", "m/s", tuple(each.speed[:, axle] for each in every)),
            "slip": _wheel("slip", "", 1.0, axle, runs),
            "sinkage": _wheel("sinkage", "mm", 1e3, axle, runs),
        }
        for axle in range(axles)
    ]
    for axle, each in enumerate(own):
        if nominal.places is None:
            each["load"] = _load(nominal, runs, fitted, axle, each["slip"], each["sinkage"])
        else:
            each["slip angle"] = _slip_angle(axle, runs)
    if nominal.places is not None:
        shared["yaw rate"] = _yaw_rate(axles, runs)
    mean = {kind: _mean([each[kind] for each in own]) for kind in ("speed", "slip", "sinkage")}
    single = [
        dataclasses.replace(each[kind], name=f"{kind} of the {wheels_name(axle, nominal)}")
        for axle, each in enumerate(own)
        for kind in each
        if kind != "speed"
    ]
    return shared | mean | {each.name: each for each in single}, [shared | each for each in own]


def _wheel(name: str, unit: str, factor: float, axle: int, runs: Sequence[Blocks]) -> Signal:
    """Return slip or sinkage of one axle."""
    values, noise = [], []
    for run in runs:
        view = view_of(run.packed, run.wheel_rate.shape[-1])
        value, sd = (getattr(view, field)[..., axle] for field in (name, f"{name}_sd"))
        values.append(factor * getattr(run.signals, name)[:, axle])
        noise.append(_jitter(value, sd, factor))
    return Signal(name, unit, tuple(values), tuple(noise))


def _mean(parts: Sequence[Signal]) -> Signal:
    """Return the mean of one signal over the axles."""
    values = tuple(
        torch.stack(each).mean(0) for each in zip(*(part.values for part in parts), strict=True)
    )
    noise = tuple(
        Jitter(
            math.sqrt(sum(each.sd**2 for each in every)) / len(every),
            max(each.alike for each in every),
        )
        for every in zip(*(part.noise for part in parts), strict=True)
    )
    return dataclasses.replace(parts[0], values=values, noise=noise)


def _jitter(value: Tensor, sd: Tensor, factor: float) -> Jitter:
    """Return the noise of the mean over the neighbouring blocks.

    From measured values and their deviations [B, n].

    Differences between samples show what lasts from one to the next: half of their variance is
    missing where noise does. The median keeps the few large differences of a sharp start out.
    """
    count = value.shape[1]
    spread = (torch.diff(value, dim=1) / sd[:, 1:]).square().median() / _MEDIAN_SQUARE
    kept = min(max(1.0 - 0.5 * float(spread), 0.0), 0.999)
    apart = torch.arange(3 * count, dtype=torch.float64)
    covariance = kept ** (apart - apart.unsqueeze(1)).abs()
    parts = covariance.view(3, count, 3, count).mean((1, 3))
    around = 0.5 * (parts[0, 0] + parts[0, 2])
    return Jitter(
        factor * float((sd.square().mean() * around).sqrt()),
        float(parts[0, 1] / (around * parts[0, 0]).sqrt()) if kept > LEAST_KEPT else 0.0,
    )


_MEDIAN_SQUARE = 0.4549
"""Median of the square of a standard normal number."""
LEAST_KEPT = 0.1
"""[1] Correlation of noise from sample to sample below which it does not reach the next second."""
LARGEST_NOISE = 0.5
"""[1] Deviation of the noise of a signal over that of the signal, above which it is not used."""


def _yaw_rate(wheels: int, runs: Sequence[Blocks]) -> Signal:
    """Return the yaw rate, positive to the left."""
    motions = [body_motion(view_of(run.packed, wheels)) for run in runs]
    noise = tuple(_jitter(each.yaw_rate, each.yaw_rate_sd, 1.0) for each in motions)
    return Signal("yaw rate", "rad/s", tuple(run.signals.yaw_rate[:, 0] for run in runs), noise)


def _slip_angle(wheel: int, runs: Sequence[Blocks]) -> Signal:
    """Return the angle of a hub's way to the left of its heading.

    Its noise is taken to be that of the lateral velocity and of the yaw rate at the place of the
    body's origin, over the speed of the rim.
    """
    values, noise = [], []
    for run in runs:
        motion = body_motion(view_of(run.packed, run.wheel_rate.shape[-1]))
        speed = motion.rim[..., wheel].abs().clamp(min=SLOWEST)
        jitter = _jitter(motion.lateral, motion.lateral_sd, 1.0)
        factor = math.degrees(float((1.0 / speed).mean()))
        values.append(torch.rad2deg(run.signals.slip_angle[:, wheel]))
        noise.append(Jitter(factor * jitter.sd, jitter.alike))
    return Signal("slip angle", "deg", tuple(values), tuple(noise))


def wheels_name(station: int, nominal: Nominal) -> str:
    """Return ``middle wheels``, or ``front left wheel`` where wheels are taken one by one."""
    if nominal.places is None:
        return f"{axle_name(station, nominal.rover.axles)} wheels"
    return f"{nominal.wheels[station].replace('_', ' ')} wheel"


def axle_name(axle: int, axles: int) -> str:
    """Return ``front``, ``middle`` or ``rear``."""
    return AXLES[axles][axle]


def _load(
    nominal: Nominal,
    runs: Sequence[Blocks],
    fitted: Sequence[Unknowns],
    axle: int,
    slip: Signal,
    sinkage: Signal,
) -> Signal:
    """Return the normal force of one wheel [N] by slips and sinkages of nearby seconds."""
    values, noise = [], []
    for run, unknowns, slips, sinks in zip(runs, fitted, slip.noise, sinkage.noise, strict=True):
        here = nominal.of(run)
        contact, where, law = here.contact, run.signals, contact_law(here.soil.law)
        constants = contact.constants + unknowns.kappa @ here.uncertain
        theta = torch.cat(
            [unknowns.theta * contact.column_unit[:2], torch.ones(1, dtype=torch.float64)]
        )
        places = torch.tensor(
            [[0.0, 0.0], [slips.sd, 0.0], [0.0, 1e-3 * sinks.sd]], dtype=torch.float64
        ).unsqueeze(2)
        moved = (where.slip[:, axle] + places[:, 0], where.sinkage[:, axle] + places[:, 1])
        load = (
            law(*moved, constants, contact.radius, contact.width, contact.nodes)[..., 0, :] @ theta
        )
        values.append(load[0])
        noise.append(
            Jitter(
                float((load[1:] - load[0]).square().sum(0).mean().sqrt()),
                max(slips.alike, sinks.alike),
            )
        )
    return Signal("load", "N", tuple(values), tuple(noise))


def _gain(run: Blocks) -> Tensor:
    """Return the acceleration of the rims [B, A] [m/s^2] between the neighbouring blocks."""
    time, speed = run.signals.time, run.signals.speed
    after, before = torch.cat([speed[1:], speed[-1:]]), torch.cat([speed[:1], speed[:-1]])
    passed = torch.cat([time[1:], time[-1:]]) - torch.cat([time[:1], time[:-1]])
    return (after - before) / passed


def _shapes(row: str, signal: Signal) -> list[tuple[Region, list[Tensor]]]:
    """Return the regions of one signal, with their values in every run."""
    every = torch.cat(signal.values)
    low, high = (float(torch.quantile(every, share)) for share in (0.1, 0.9))
    if signal.mostly_noise or not high - low > 1e-9 * max(abs(high), abs(low)):
        return []
    found: list[tuple[Region, list[Tensor]]] = []
    for above, shares in ((True, ABOVE), (False, BELOW)):
        for end in dict.fromkeys(
            _rounded(float(torch.quantile(every, share)), high - low) for share in shares
        ):
            inside = [
                ((value > end) if above else (value < end)).to(torch.float64)
                for value in signal.values
            ]
            count = float(torch.cat(inside).sum())
            if FEWEST <= count <= every.shape[0] - FEWEST:
                found.append(
                    (
                        Region(row, signal.name, _words(signal, end, above=above), signal.alike),
                        inside,
                    )
                )
    middle, change = 0.5 * (low + high), high - low
    ends = f"{_number(low, change)} to {_number(high, change)} {signal.unit}".rstrip()
    found.append(
        (
            Region(row, signal.name, f"in proportion, from {ends}", signal.alike),
            [(value - middle) / change for value in signal.values],
        )
    )
    return found


def _words(signal: Signal, end: float, *, above: bool) -> str:
    side = "above" if above else "below"
    if signal.name == "slope" and abs(end) > 0.0 and above == (end > 0.0):
        return f"above {abs(end):g} deg {'uphill' if above else 'downhill'}"
    return f"{side} {end:g} {signal.unit}".rstrip()


def _rounded(value: float, spread: float) -> float:
    """Round to about a hundredth of the spread, so that the words give the exact region."""
    digits = 1 - math.floor(math.log10(spread))
    return round(value, digits)


def _number(value: float, spread: float) -> str:
    return f"{_rounded(value, spread):g}"
