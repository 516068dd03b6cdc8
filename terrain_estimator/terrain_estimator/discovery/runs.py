# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs, cut into blocks of one second whose observations are linked."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.off_plane import SingleWheels
from terrain_estimator.estimator.screening import screen
from terrain_estimator.model.body_motion import body_motion, moves
from terrain_estimator.model.packed_observation import (
    BLOCK,
    TurningBody,
    ground_torque,
    link,
    pack,
)
from terrain_estimator.model.packing import PackedView, view_of, with_slip, without_link
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.rows import ContactModel, usable_wheels
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.outcome import Outcome
from terramechanics.contact.ruts import ruts_by_distance
from terramechanics.contact.scm import Rut
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_balances import motion_across

PIECE = 5
"""[blocks] of a rollout: five seconds, linked."""


class RunError(ValueError):
    """A run cannot be used."""


@dataclass(frozen=True, slots=True)
class RecordedRun:
    """The measurements of one drive."""

    name: str
    packed: Tensor  # [T, P] observations of terrain_estimator.model.packing
    wheel_rate: Tensor  # [T, A] [rad/s], NaN where it is not measured
    time: Tensor  # [T] [s] since the start


class Refusals:
    """Counts of refused observations, with the first reason of each kind."""

    def __init__(self) -> None:
        """Begin without any."""
        self._counts: Counter[Outcome] = Counter()
        self._first: dict[Outcome, str] = {}

    def add(self, outcome: Outcome, detail: str) -> None:
        """Count one more."""
        self._counts[outcome] += 1
        self._first.setdefault(outcome, detail)

    def __str__(self) -> str:
        """Return the counts in words, the most frequent first."""
        reasons = (
            f"{count} {outcome.name} ({self._first[outcome]}): {outcome.advice}"
            for outcome, count in self._counts.most_common()
        )
        return "; ".join(reasons) or "there is none"


def run_of(
    name: str,
    observations: Iterable[Observation],
    rover: Rover,
    config: CoreConfig,
    refusals: Refusals,
    wheels: SingleWheels | None = None,
) -> RecordedRun:
    """Return the run of these observations, screened as the estimator does.

    Refused ones are added to ``refusals``. ``wheels`` are those of a rover whose wheels are taken
    one by one; None: it is by axle.

    Raises:
        RunError: none of them can be used, and why.
    """
    body = TurningBody(rover.wheel_radius, rover.gravity, rover.centre_of_mass_x)
    last: Observation | None = None
    packed: list[Floats] = []
    rates: list[Floats] = []
    stamps: list[int] = []
    for observation in observations:
        previous_ns = last.stamp_ns if last else None
        screening = screen(
            observation, previous_ns, rover, config, sinkage_needed=True, wheels=wheels
        )
        if not screening.outcome.used:
            refusals.add(screening.outcome, screening.detail)
            continue
        used = screening.observation
        passed_s, linked = link(used.stamp_ns, last, TIME_STEP)
        packed.append(
            pack(
                used,
                ground_torque(used, last if linked else None, rover.wheel_inertia, passed_s),
                passed_s,
                linked=linked,
                body=None if wheels is None else body,
            )
        )
        rates.append(used.wheel_rate)
        stamps.append(used.stamp_ns)
        last = used
    if not packed:
        raise RunError(f"{name}: no observation can be used: {refusals}")
    seconds = torch.tensor([(stamp - stamps[0]) * 1e-9 for stamp in stamps], dtype=torch.float64)
    return RecordedRun(
        name, torch.from_numpy(np.stack(packed)), torch.from_numpy(np.stack(rates)), seconds
    )


@dataclass(frozen=True, slots=True)
class Signals:
    """The signals on which a discrepancy may depend, [B, A] or [B, 1], smooth in time.

    Measured signals are means over the two neighbouring blocks, never of the block itself: the
    noise of a signal moves the rows of its own block, so that residuals correlate with it where
    nothing is missing.
    """

    slip: Tensor  # [B, A]
    sinkage: Tensor  # [B, A] [m]
    speed: Tensor  # [B, A] [m/s] of the rim
    pitch: Tensor  # [B, 1] [rad]
    pitch_rate: Tensor  # [B, 1] [rad/s]
    time: Tensor  # [B, 1] [s]
    distance: Tensor  # [B, 1] [m]
    slip_rate: Tensor  # [B, A] [1/s]
    sinkage_rate: Tensor  # [B, A] [m/s]
    # of a rover whose wheels are taken one by one; else without columns
    yaw_rate: Tensor  # [B, 1] [rad/s]
    slip_angle: Tensor  # [B, A] [rad] of the way of each hub to the left of its heading


@dataclass(frozen=True, slots=True)
class Blocks:
    """The B blocks of a run; V velocities join them."""

    name: str
    packed: Tensor  # [B, BLOCK, P]; the first observation of an unlinked block covers no time
    wheel_rate: Tensor  # [B, BLOCK, A] [rad/s]
    ends: Tensor  # [B, 2] numbers of the velocity before and after the block
    velocities: int  # V
    signals: Signals
    soil: Soil | None = None  # below this run; None: that of the nominal model
    ruts: Rut | None = None  # [B, BLOCK, A] below each wheel, by distance; None: not known
    encoders: bool = True  # False where wheel rates are only those of velocity and slip
    by_wheel: tuple[str, ...] = ()  # rows, where wheels are taken one by one

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the rows, in their order."""
        return self.by_wheel or row_names(self.wheel_rate.shape[-1])

    def between(self, first: int, last: int) -> "Blocks":
        """Return blocks ``first`` to ``last - 1`` as a run of their own."""
        here = slice(first, last)
        ends = self.ends[here] - self.ends[first, 0]
        signals = Signals(*(getattr(self.signals, item.name)[here] for item in fields(Signals)))
        return replace(
            self,
            packed=self.packed[here],
            wheel_rate=self.wheel_rate[here],
            ends=ends,
            velocities=int(ends[-1, 1]) + 1,
            signals=signals,
            ruts=None if self.ruts is None else Rut(*(part[here] for part in self.ruts)),
        )

    def follows(self) -> Tensor:
        """Return whether each block continues the one before, [B] bool."""
        joined = self.ends[1:, 0] == self.ends[:-1, 1]
        return torch.cat([torch.zeros(1, dtype=torch.bool), joined])

    def pieces(self, length: int) -> list[int]:
        """Return the first blocks of pieces of ``length`` linked blocks, one after the other."""
        found, first = [], 0
        for number, joined in enumerate(self.follows().tolist()):
            first = first if joined else number
            if number - first == length - 1:
                found.append(first)
                first = number + 1
        return found


def cut(run: RecordedRun, nominal: ContactModel) -> Blocks:
    """Cut a run into blocks in which every wheel is measured and in range.

    Raises:
        RunError: fewer than five such blocks.
    """
    found, time = _cut(run, usable_wheels(run.packed, nominal), nominal)
    return replace(found, ruts=_ruts(found.packed, time, nominal))


def cut_by_wheel(run: RecordedRun, physics: PhysicsByWheel, rows: tuple[str, ...]) -> Blocks:
    """Cut a run of single wheels, as :func:`cut` does; ``rows`` are the rows' names.

    Ruts are not known: a turn decides which wheels rolled before.
    """
    view = view_of(run.packed, physics.axles)
    contact = physics.nominal.nominal_contact()
    inside = with_slip(run.packed, physics.inside(view.slip))
    usable = usable_wheels(inside, contact) & moves(body_motion(view))
    return replace(_cut(run, usable, contact)[0], by_wheel=rows)


def _cut(run: RecordedRun, usable: Tensor, contact: ContactModel) -> tuple[Blocks, Tensor]:
    """Return blocks in which all wheels are ``usable`` [T, A], and their times [B, BLOCK]."""
    axles = contact.geometry.axle_x.shape[0]
    linked = view_of(run.packed, axles).linked > 0.0
    starts, begins = _starts(usable.all(1).tolist(), linked.tolist())
    if len(starts) < _FEWEST:
        raise RunError(
            f"{run.name}: {len(starts)} whole seconds of linked observations with every wheel in"
            f" range, at least {_FEWEST} are needed"
        )
    index = torch.tensor(starts).unsqueeze(1) + torch.arange(BLOCK)
    packed = run.packed[index].clone()
    fresh = torch.tensor(begins)
    packed[fresh, 0] = without_link(packed[fresh, 0])
    # A block that begins anew has a velocity of its own at its start.
    last = torch.cumsum(1 + fresh.long(), 0) - 1
    rate = run.wheel_rate[index]
    known = torch.where(torch.isfinite(rate), rate, _rim_rate(packed, axles, contact.radius))
    signals = _signals(packed, known * contact.radius, run.time[index], contact.geometry.axle_x)
    blocks = Blocks(
        run.name,
        packed,
        known,
        torch.stack([last - 1, last], 1),
        int(last[-1]) + 1,
        signals,
        encoders=bool(torch.isfinite(rate).any()),
    )
    return blocks, run.time[index]


_FEWEST = 5


def _ruts(packed: Tensor, time: Tensor, nominal: ContactModel) -> Rut:
    """Return the ruts [B, n, A] that the wheels before left below every wheel.

    Slip and sinkage of the wheels before are means over a block.
    """
    axle_x = nominal.geometry.axle_x
    view = view_of(packed, axle_x.shape[0])
    speed, seconds = view.velocity.mean(1).clamp(min=0.0), time.mean(1)
    gone = torch.nn.functional.pad(torch.cumulative_trapezoid(speed, seconds), [1, 0])
    at = gone.unsqueeze(1) + speed.unsqueeze(1) * (time - seconds.unsqueeze(1))
    ruts = ruts_by_distance(
        gone, view.slip.mean(1), view.sinkage.mean(1), axle_x, nominal.radius, at.flatten()
    )
    return Rut(*(part.view(*time.shape, -1) for part in ruts))


def _starts(usable: list[bool], linked: list[bool]) -> tuple[list[int], list[bool]]:
    """Return the first observation of each whole block, and whether the block begins anew."""
    starts: list[int] = []
    begins: list[bool] = []
    first, count, fresh = 0, 0, True
    for t, (good, joined) in enumerate(zip(usable, linked, strict=True)):
        if count == 0 or not good or not joined:
            first, count = t, 0
            fresh = not (good and joined and starts and starts[-1] + BLOCK == t)
        count = count + 1 if good else 0
        if count == BLOCK:
            starts.append(first)
            begins.append(fresh)
            count = 0
    return starts, begins


def _rim_rate(packed: Tensor, axles: int, radius: float) -> Tensor:
    """Return the mean wheel rate of each block from velocity and slip, without an encoder."""
    view = view_of(packed, axles)
    rim = view.velocity.unsqueeze(-1) / (1.0 - view.slip.clamp(max=0.9)) / radius
    return rim.mean(1, keepdim=True).expand(-1, packed.shape[1], -1)


def _signals(packed: Tensor, speed: Tensor, time: Tensor, axle_x: Tensor) -> Signals:
    view = view_of(packed, speed.shape[-1])
    slip, slip_rate = _around(view.slip.mean(1), time)
    sinkage, sinkage_rate = _around(view.sinkage.mean(1), time)
    seconds = time.mean(1, keepdim=True)
    gone = torch.cumsum(view.velocity.mean(1), 0).unsqueeze(1) * (BLOCK * view.step.max())
    pitch, pitch_rate = _around(view.pitch.mean(1, keepdim=True), time)
    yaw_rate, slip_angle = (_around(each, time)[0] for each in _turning(view, axle_x))
    return Signals(
        slip, sinkage, speed.mean(1), pitch, pitch_rate, seconds, gone, slip_rate, sinkage_rate,
        yaw_rate, slip_angle,
    )  # fmt: skip


def _turning(view: PackedView, axle_x: Tensor) -> tuple[Tensor, Tensor]:
    """Return yaw rate [B, 1] and slip angles [B, A]; without columns of a rover by axle."""
    if view.wheel_rate.shape[-1] <= view.slip.shape[-1]:
        none = torch.zeros(view.slip.shape[0], 0, dtype=torch.float64)
        return none, none
    motion = body_motion(view)
    left = motion.lateral.unsqueeze(-1) + motion.yaw_rate.unsqueeze(-1) * axle_x
    _, along, across = motion_across(view.slip, motion.rim, motion.steering, left)
    angle = torch.atan2(across.mean(1), along.mean(1).abs())
    return motion.yaw_rate.mean(1, keepdim=True), angle


def _around(means: Tensor, time: Tensor) -> tuple[Tensor, Tensor]:
    """Return the mean of the blocks before and after each, and the slope between them.

    At an end the only neighbour and no slope.
    """
    seconds = time.mean(1, keepdim=True)
    before, after = torch.cat([means[1:2], means[:-1]]), torch.cat([means[1:], means[-2:-1]])
    apart = torch.cat([seconds[1:], seconds[-2:-1]]) - torch.cat([seconds[1:2], seconds[:-1]])
    slope = torch.where(apart > 0.0, (after - before) / apart.clamp(min=1e-9), 0.0)
    return 0.5 * (before + after), slope
