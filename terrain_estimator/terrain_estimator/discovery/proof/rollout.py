# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Five seconds of a held-out run, simulated from the wheel rates and compared with the sensors.

A window starts in the measured velocity of its first observation. From then on the simulation has
the wheel rates, the terrain along the track and the ruts that were measured there; slip, sinkage,
torque and velocity are its own, and pass through what the effects do to the sensors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.rows import Nominal, corrected
from terrain_estimator.discovery.proof.held_out import GroundEstimate, Half, Model
from terrain_estimator.discovery.proof.signals import MeasuredSignals, measured
from terrain_estimator.discovery.proof.terrain import noisier, profile_of, track_of
from terrain_estimator.discovery.runs import PIECE
from terrain_estimator.model.gaussian import cholesky
from terrain_estimator.model.packed_observation import BLOCK
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.rows import PA_PER_UNIT
from terramechanics.contact.ruts import KnownRuts
from terramechanics.contact.scm import Rut
from terramechanics.simulation.schedules import Command
from terramechanics.simulation.simulation import Simulation
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.profile import Sampled

WEAKEST = 0.01
"""[1] Least c [kPa] and tan phi that are simulated."""
FASTER = 2.0
"""[1] By which a simulated rover may outrun the measured one before it leaves the known terrain."""
DETERMINED = 0.5
"""[1] Share of the prior's variance above which runs say nothing about a direction."""
TERRAINS = 4
"""Terrains that are simulated to see what the noise of the angles does to predictions."""


@dataclass(frozen=True, slots=True)
class Windows:
    """All windows of some halves; T = PIECE BLOCK observations."""

    half: Tensor  # [W] number of the half
    first: Tensor  # [W] number of the first block in it
    rate: Tensor  # [W, T, A] [rad/s]
    velocity: Tensor  # [W, 2] [m/s] measured at the start, and its deviation
    step: float  # [s]
    longest: float  # [m] that a simulated rover may go
    constants: Tensor  # [W, 6] of the soil
    uncertain: Tensor  # [W, M, 6] as ``Nominal.uncertain``
    measured: MeasuredSignals
    gone: Tensor  # [W, T] [m] since the start, measured
    ruts: Rut | None  # [W, A, T] below the wheels there


@dataclass(frozen=True, slots=True)
class SimulatedSignals:
    """Signals of one model at every observation of the windows but the first, and their changes."""

    signals: Tensor  # [W, T - 1, R]
    # [G, W, T - 1, R] along the columns of a factor of the covariance of start, ground, and of
    # sizes as far as runs determined them
    changes: Tensor
    by_terrain: Tensor  # [TERRAINS, W, T - 1, R] with other terrains that the measured angles allow


def windows_of(nominal: Nominal, halves: Sequence[Half]) -> Windows:
    """Return the windows of some halves."""
    axles = nominal.rover.axles
    firsts = [torch.tensor(half.blocks.pieces(PIECE), dtype=torch.long) for half in halves]
    index = [first.unsqueeze(1) + torch.arange(PIECE) for first in firsts]
    packed = torch.cat(
        [half.blocks.packed[here].flatten(1, 2) for half, here in zip(halves, index, strict=True)]
    )
    rate = torch.cat(
        [
            half.blocks.wheel_rate[here].flatten(1, 2)
            for half, here in zip(halves, index, strict=True)
        ]
    )
    view = view_of(packed, axles)
    gone = (view.velocity * view.step).sum(1)
    half = torch.repeat_interleave(torch.tensor([len(first) for first in firsts]))
    grounds = [nominal.of(each.blocks) for each in halves]
    return Windows(
        half=half,
        first=torch.cat(firsts),
        rate=rate,
        velocity=torch.stack([view.velocity[:, 0], view.velocity_sd[:, 0]], 1),
        step=float(view.step[:, 1:].median()),
        longest=FASTER * float(gone.max()),
        measured=measured(packed[:, 1:], axles),
        gone=torch.cumsum(view.velocity * view.step, 1) - view.velocity[:, :1] * view.step[:, :1],
        ruts=_ruts(halves, index),
        constants=torch.stack([each.contact.constants for each in grounds])[half],
        uncertain=torch.stack([each.uncertain for each in grounds])[half],
    )


def _ruts(halves: Sequence[Half], index: Sequence[Tensor]) -> Rut | None:
    """Return the ruts [W, A, T] below the wheels in every window; None where they are not known."""
    found = [
        Rut(*(part[here].flatten(1, 2).transpose(1, 2) for part in half.blocks.ruts))
        for half, here in zip(halves, index, strict=True)
        if half.blocks.ruts is not None
    ]
    whole = len(found) == len(halves)
    return Rut(*(torch.cat(part) for part in zip(*found, strict=True))) if whole else None


def simulated(
    nominal: Nominal, halves: Sequence[Half], windows: Windows, number: int, model: Model, seed: int
) -> SimulatedSignals:
    """Simulate all windows under the model of that ``number``; ``seed`` of the other terrains."""
    generator = torch.Generator().manual_seed(seed)
    values = tuple(model.values.tolist())
    hypothesis = model.hypothesis
    rover = hypothesis.rover(nominal.rover, values)
    laws, own = hypothesis.laws(rover), values[len(hypothesis.doubt) :]
    clean = [corrected(rover, laws, own, half.blocks) for half in halves]
    terrain = _terrain(nominal, windows, clean)
    others = [
        _terrain(
            nominal, windows, [noisier(each, nominal.rover.axles, generator) for each in clean]
        )
        for _ in range(TERRAINS)
    ]
    centres, factors = zip(*(_known(half.grounds[number]) for half in halves), strict=True)
    centre, columns = (
        torch.stack(centres)[windows.half],
        torch.stack(factors)[windows.half].unbind(-1),
    )
    start = windows.velocity[:, 0]
    grounds = [centre, centre, *(centre + column for column in columns), *([centre] * TERRAINS)]
    terrains = [terrain] * (2 + len(columns)) + others
    starts = [start, start + windows.velocity[:, 1], *([start] * (len(columns) + TERRAINS))]
    found = _drive(
        nominal,
        windows,
        torch.cat(grounds),
        _together(terrains),
        torch.cat(starts),
        model,
        values,
    )
    found = found.view(len(grounds), *windows.measured.values.shape)
    base, changes, by_terrain = torch.split(found, [1, 1 + len(columns), TERRAINS])
    by_size = [
        _drive(nominal, windows, centre, terrain, start, model, sizes).unsqueeze(0)
        for sizes in _other_sizes(model)
    ]
    return SimulatedSignals(base[0], torch.cat([changes, *by_size]) - base, by_terrain - base)


def _known(ground: GroundEstimate) -> tuple[Tensor, Tensor]:
    """Return c, tan phi and soil constants [2 + M], and a factor of their covariance.

    Given that c and tan phi are physical.
    """
    own = 2 + ground.unknowns.kappa.shape[0]
    centre = torch.cat([ground.unknowns.theta, ground.unknowns.kappa])
    covariance = ground.covariance[:own, :own]
    for k in (0, 1):
        if centre[k] < WEAKEST:
            centre = centre + covariance[:, k] / covariance[k, k] * (WEAKEST - centre[k])
    return centre, cholesky(covariance)


def _other_sizes(model: Model) -> list[tuple[float, ...]]:
    """Return sizes along each direction that runs determined, inside of their ranges."""
    shared = model.hypothesis.shared()
    found = []
    for column in determined(model.covariance, shared.sd).T:
        there = model.values + column
        there = torch.where(
            (there < shared.low) | (there > shared.high), model.values - column, there
        )
        found.append(tuple(there.clamp(shared.low, shared.high).tolist()))
    return found


def determined(covariance: Tensor, prior_sd: Tensor) -> Tensor:
    """Return a factor [K, n] of a covariance [K, K] in the n directions that runs determined.

    In the others more than DETERMINED of the prior's variance [K] is left: the spread there is that
    of an assumption, such as the place of a payload without a bogie angle, and no error to expect.
    """
    share, direction = torch.linalg.eigh(covariance / (prior_sd.unsqueeze(1) * prior_sd))
    kept = share < DETERMINED
    return prior_sd.unsqueeze(1) * direction[:, kept] * share[kept].clamp(min=0.0).sqrt()


def _terrain(nominal: Nominal, windows: Windows, clean: Sequence[Tensor]) -> Sampled:
    """Return the terrain in front of every window, from the observations of each half."""
    parts = []
    for number, packed in enumerate(clean):
        first = windows.first[windows.half == number]
        if len(first):
            track = track_of(packed, nominal.rover)
            parts.append(
                profile_of(track, track.distance[BLOCK * first], windows.longest, nominal.rover)
            )
    return _together(parts)


def _together(parts: Sequence[Sampled]) -> Sampled:
    return Sampled(
        torch.cat([part.slope for part in parts]),
        torch.cat([part.curvature for part in parts]),
        parts[0].start,
        parts[0].spacing,
    )


def _drive(
    nominal: Nominal,
    windows: Windows,
    grounds: Tensor,
    terrain: Sampled,
    start: Tensor,
    model: Model,
    values: tuple[float, ...],
) -> Tensor:
    """Return signals [G W, T - 1, R] on ``grounds`` [G W, 2 + M] from ``start`` [G W] [m/s].

    They are those of the ``model`` with these ``values`` of its hypothesis.
    """
    hypothesis, times = model.hypothesis, len(grounds) // len(windows.first)
    rover, plant = (
        hypothesis.rover(nominal.rover, values),
        hypothesis.plant(values, nominal.rover),
    )
    strength = grounds[:, :2].clamp(min=WEAKEST) * torch.tensor(
        [PA_PER_UNIT, 1.0], dtype=torch.float64
    )
    shift = (grounds[:, 2:].unsqueeze(1) @ windows.uncertain.repeat(times, 1, 1)).squeeze(1)
    constants = windows.constants.repeat(times, 1) + shift
    soil = Ground([Patch(constants, strength, law=nominal.soil.law)])
    rate = windows.rate.repeat(times, 1, 1)
    series = []
    with torch.inference_mode():
        ruts = None if windows.ruts is None else KnownRuts(windows.gone, windows.ruts, times)
        simulation = Simulation(rover, soil, terrain, start, windows.step, plant, ruts)
        simulation.rate = rate[:, 0].clone()
        for command in rate[:, 1:].unbind(1):
            before = simulation.rate
            seen = simulation.sensed(simulation.step(Command.RATE, command))
            # As in observations: what turns the wheel itself is no torque on the ground.
            torque = seen.torque - rover.wheel_inertia * (command - before) / windows.step
            signals = [seen.velocity.unsqueeze(-1), seen.slip, seen.sinkage, torque]
            series.append(torch.cat(signals, -1))
    return torch.stack(series, 1)
