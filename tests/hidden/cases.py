# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden cases: five one-minute drives on one soil, with the same hidden effects.

What a case is follows from its plan, its number and one seed. Many cases of one plan are simulated
together.
"""

import dataclasses
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.presets import load_rover
from terramechanics.simulation.plant import Effect, Plant
from terramechanics.simulation.sample import TIME_STEP, Drive, Measurement
from terramechanics.simulation.sensors import Noise, measure_drive, per_wheel
from terramechanics.simulation.simulation import STUCK_TIME, simulate
from terramechanics.vehicle.rover import Rover
from tests.hidden.constants import NAMES, Constants, beyond, by_radius, with_errors
from tests.hidden.equivalent import equivalent_size
from tests.hidden.generators import GENERATORS, SCALES, Draw, sizes_of
from tests.hidden.ground import SOILS, draw_ground, draw_terrain, uniform

DRIVES = 5
SPARE = 3
"""Drives of a case that are simulated in addition, to replace those that get stuck."""
EACH = DRIVES + SPARE
TERRAINS = ("hills", "flat", "hills", "ramp")
"""Terrains of cases in turn."""
SHORTEST = 30.0
"""[s] A drive that gets stuck earlier is replaced by a spare one."""


def _other(radius: float, mass: float, width: float) -> Rover:
    """Return a rover that differs from the Mars-like one by these factors."""
    car = load_rover("mars_rover")
    return dataclasses.replace(
        car,
        name="other_rover",
        mass=mass * car.mass,
        wheel_radius=radius * car.wheel_radius,
        wheel_width=width * car.wheel_width,
    )


ROVERS: dict[str, Callable[[], Rover]] = {
    "mars_rover": lambda: load_rover("mars_rover"),
    "paper_rover": lambda: load_rover("paper_rover"),
    "light_rover": lambda: _other(0.85, 0.6, 0.8),
    "heavy_rover": lambda: _other(1.2, 1.4, 1.15),
}
"""Rovers of hidden cases: those that ship, and two that no model is for."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Hidden effects of a case: ``parts`` are names, each with a share of the size that matters.

    A size without a share is drawn from the range of its law, see sizes_of.
    """

    parts: tuple[tuple[str, float | None], ...] = ()
    torque: bool = True  # whether motor torque is measured
    noise_time: float = 0.0  # [s] time constant of the sensors' noise, 0: white
    soil: str = ""  # empty: every soil in turn
    seconds: float = 60.0  # [s] length of a drive
    noise: float = 1.0  # deviation of the sensors' noise over the stated one
    told: str = ""  # soil that the workflow is told; empty: the true one
    rover: str = ""  # one of ROVERS; empty: the caller's
    between: float = 0.0  # share of the way from ``soil`` to ``told`` at which the ground lies
    stated: Constants = ()  # deviations of the rover's constants that the workflow may be told
    off: Constants = ()  # true constants of the rover less those of its file

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a right verdict; empty for "none", ("unknown",) outside the library."""
        if any(not GENERATORS[name].known for name, _ in self.parts):
            return ("unknown",)
        own = tuple(name for name, _ in self.parts)
        return (*own, NAMES[self.beyond]) if self.beyond else own

    @property
    def beyond(self) -> str:
        """The rover's constant whose error was not stated; empty where every one was."""
        return beyond(self.stated, self.off)

    @property
    def file(self) -> Rover | None:
        """The rover as its file has it; None for the caller's."""
        return ROVERS[self.rover]() if self.rover else None

    @property
    def text(self) -> str:
        """What is planned, in words from which the cases follow: a new field leaves old cases."""
        given = (
            f"{each.name}={getattr(self, each.name)!r}"
            for each in dataclasses.fields(self)
            if each.name in _FIRST or getattr(self, each.name) != each.default
        )
        return f"Plan({', '.join(given)})"


_FIRST = ("parts", "torque", "noise_time", "soil", "seconds")
"""Fields that are always part of a plan's text."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Truth of a case, for the judge only."""

    plan: Plan
    soil: str  # given to the workflow, not in the bags
    terrain: str
    sizes: tuple[float, ...]  # of the plan's parts, in the units of the hidden laws
    equivalents: tuple[
        float, ...
    ]  # the same in the units of the named laws, see equivalent.py; NaN where there is none
    axle: int  # of a failed wheel
    cohesion_pa: tuple[float, ...]  # of each drive
    tan_phi: tuple[float, ...]
    constants: tuple[tuple[float, ...], ...]
    seconds: tuple[float, ...]  # length of each drive: it ends where the rover gets stuck
    stuck: float  # share of all simulated drives of the case that got stuck


@dataclass(frozen=True, slots=True)
class Case:
    """Five measured drives and the truth about them."""

    rover: Rover  # as its file has it
    drives: list[Measurement]  # [time, wheels] and [time]
    truth: Truth


@dataclass(frozen=True, slots=True)
class Simulated:
    """Drives of some cases of one plan, EACH of one case after the other, and their draws."""

    drive: Drive
    measured: Measurement  # of every wheel
    soils: list[str]  # of each case
    terrains: list[str]
    sizes: list[Tensor]  # of each part of the plan: [cases]
    effects: list[Effect]
    axle: Tensor  # [cases]
    told: Rover  # as its file has it


def simulate_cases(
    plan: Plan, count: int, seed: int, rover: str = "mars_rover", first: int = 0
) -> Simulated:
    """Simulate and measure ``count`` cases.

    Hidden effects have their own random numbers, so that other plans get the same drives.

    ``first`` is the number of the first case among those that take soils and terrains in turn.
    """
    generator, hiding = (
        torch.Generator().manual_seed(2 * seed),
        torch.Generator().manual_seed(2 * seed + 1),
    )
    told = plan.file or load_rover(rover)
    car = with_errors(told, plan.off)
    turns = range(first, first + count)
    soils = [plan.soil or SOILS[k % len(SOILS)] for k in turns]
    terrains = [TERRAINS[k // len(SOILS) % len(TERRAINS)] for k in turns]
    ground = draw_ground(
        [name for name in soils for _ in range(EACH)], generator, plan.told, plan.between
    )
    terrain = draw_terrain([name for name in terrains for _ in range(EACH)], car, ground, generator)
    axle = torch.randint(car.axles, (count,), generator=hiding)
    place = uniform((2.0, 5.0), (count * EACH,), hiding)
    sizes = [
        sizes_of(hidden, share, count, hiding, SCALES[hidden.scale](car))
        for hidden, share in ((GENERATORS[name], share) for name, share in plan.parts)
    ]
    draws = [
        Draw(size.repeat_interleave(EACH), axle.repeat_interleave(EACH), place) for size in sizes
    ]
    effects = [
        GENERATORS[name].make(draw) for (name, _), draw in zip(plan.parts, draws, strict=True)
    ]
    drive = simulate(
        car, ground, "S1", plan.seconds, generator, count * EACH, terrain, Plant(effects)
    )
    correlation = math.exp(-TIME_STEP / plan.noise_time) if plan.noise_time else 0.0
    stated = per_wheel(car, drive.seen)
    measured = measure_drive(car, stated, Noise(factor=plan.noise), generator, correlation)
    if plan.noise != 1.0:
        measured = _with_deviations(measured, measure_drive(car, stated, Noise(), generator))
    if not plan.torque:
        measured = dataclasses.replace(measured, torque=torch.full_like(measured.torque, math.nan))
    if plan.off:
        measured = by_radius(measured, told.wheel_radius, car.wheel_radius)
    return Simulated(drive, measured, soils, terrains, sizes, effects, axle, told)


def _with_deviations(measured: Measurement, stated: Measurement) -> Measurement:
    """Return the readings of ``measured`` with the deviations of ``stated``."""
    names = (item.name for item in dataclasses.fields(Measurement) if item.name.endswith("_sd"))
    return dataclasses.replace(measured, **{name: getattr(stated, name) for name in names})


def draw_cases(
    plan: Plan, count: int, seed: int, rover: str = "mars_rover", first: int = 0
) -> list[Case]:
    """Draw ``count`` cases of one plan; the arguments determine the cases."""
    simulated = simulate_cases(
        plan, count, seed + zlib.crc32(plan.text.encode()) % 1_000_000, rover, first
    )
    return [_case(plan, simulated, k) for k in range(count)]


def _case(plan: Plan, simulated: Simulated, k: int) -> Case:
    sample, ends = simulated.drive.sample, drive_ends(simulated.drive)
    chosen = _chosen(ends, k * EACH)
    strength, constants = sample.strength[chosen, 0, 0], sample.constants[chosen, 0, 0]
    truth = Truth(
        plan=plan,
        soil=simulated.soils[k],
        terrain=simulated.terrains[k],
        sizes=tuple(float(size[k]) for size in simulated.sizes),
        equivalents=tuple(
            equivalent_size(name, effect, simulated.drive, chosen)
            for (name, _), effect in zip(plan.parts, simulated.effects, strict=True)
        ),
        axle=int(simulated.axle[k]),
        cohesion_pa=tuple(strength[:, 0].tolist()),
        tan_phi=tuple(strength[:, 1].tolist()),
        constants=tuple(tuple(row) for row in constants.tolist()),
        seconds=tuple(float(ends[j]) * TIME_STEP for j in chosen),
        stuck=float(sample.stuck[k * EACH : (k + 1) * EACH, -1].double().mean()),
    )
    return Case(simulated.told, [_cut(simulated.measured, j, int(ends[j])) for j in chosen], truth)


def drive_ends(drive: Drive, time_step: float = TIME_STEP) -> Tensor:
    """Return the samples, ``time_step`` [s] apart, of drives before a stuck second, [batch]."""
    stuck = drive.sample.stuck
    moving = (~stuck).sum(1)
    struggling = round(STUCK_TIME / time_step) - 1
    return torch.where(stuck[:, -1], (moving - struggling).clamp(min=1), moving)


def _chosen(ends: Tensor, first: int) -> list[int]:
    """Return the five drives of a case: the first that last long enough, then the longest."""
    lasting = [min(float(ends[j]) * TIME_STEP, SHORTEST) for j in range(first, first + EACH)]
    ranked = sorted(range(EACH), key=lambda j: -lasting[j])  # stable: equals stay in their order
    return sorted(first + j for j in ranked[:DRIVES])


def _cut(measured: Measurement, drive: int, end: int) -> Measurement:
    """Return one drive of a batch up to its end."""
    batch, time = measured.velocity.shape
    values = {}
    for item in dataclasses.fields(Measurement):
        value = torch.as_tensor(getattr(measured, item.name))
        values[item.name] = (value if value.dim() == 3 else value.expand(batch, time))[drive, :end]
    return Measurement(**values)
