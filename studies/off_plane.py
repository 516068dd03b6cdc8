# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What turns and cross slopes do to the estimator, which drives straight up and down.

python -m studies.off_plane prints the tables of docs/lateral.md, with --planner those of the stops.
Drives of 40 s on loose sand, with the physics alone and soil constants as stated: whatever goes
wrong comes from what is not planar.
"""

import dataclasses
import math
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from studies.command import study_parser
from studies.physics import physics_model
from studies.planner.patches import belief_of
from studies.tables import table
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.observing import turning_observations_of
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.planning.planner import Planner, Reason
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.table import TractionTable
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.sample import TIME_STEP, Sample
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.spatial import BodySample, BodySimulation, Plane
from terramechanics.terrain.field import GroundField
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.surface import WAVELENGTHS, Surface, random_waves
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.steering import skid_command, steered_command

Command = Callable[[Chassis, Tensor], tuple[Tensor, Tensor]]
DRIVES, SAMPLES, SEED = 24, 400, 71_000_000
SOIL = load_soil("loose_sand")


@dataclass(frozen=True, slots=True)
class Kind:
    """A rover with its wheels' places across, its steering, and the motions to judge."""

    rover: str
    track: float  # [m]
    yaw_inertia: float  # [kg m^2]
    command: Command
    speed: float  # [m/s]
    yaw_rates: tuple[float, ...]  # [rad/s] commanded


KINDS = (
    Kind("four_wheel_rover", 0.57, 5.0, skid_command, 0.25, (0.05, 0.1, 0.15, 0.2, 0.4, 0.8)),
    Kind("mars_rover", 1.0, 20.0, steered_command, 0.08, (0.005, 0.01, 0.02, 0.05)),
)
LEANS = (2.0, 3.0, 4.0, 6.0, 10.0, 15.0)
"""[deg] of a slope across which the rover drives."""
STEEP = 5.0
"""[deg] Steepest slope of hills and bumps."""
BUMPS = (0.8, 3.0)
"""[m] Shortest and longest waves of bumps: as long as the rovers."""
RAISED = 0.3
"""[m] Height above the hubs of a point whose velocity is taken for theirs."""
Waves = tuple[float, float]


class Judged(NamedTuple):
    """What was published at the end of some drives."""

    sideways: float  # [1] median share of the rims' speed with which the furthest axle moves aside
    refused: float  # [1] share of observations that are NOT_PLANAR
    inside: int  # drives whose 95 % intervals hold c and tan phi
    identified: int
    wrong: int  # of those, with a parameter outside
    error: tuple[float, float]  # [1] median error of c and of tan phi, of the truth


def drives(
    kind: Kind,
    yaw_rate: float,
    lean: float,
    samples: int = SAMPLES,
    waves: Waves | None = None,
    raised: float = 0.0,
) -> tuple[list[list[Observation]], Floats]:
    """Return the observations of each drive, and the true strength [drives, 2].

    ``waves`` are the shortest and the longest of uneven ground [m]. Velocity and slips are those of
    a point ``raised`` [m] above the hubs.
    """
    generator = torch.Generator().manual_seed(SEED)
    constants, surface = SOIL.constants().expand(DRIVES, 6), None
    if waves is not None:
        surface = random_waves(DRIVES, math.radians(STEEP), generator, waves)
    driven, strength = simulated(
        kind, yaw_rate, lean, samples, constants, generator, surface=surface
    )
    rover = load_rover(kind.rover)
    found = _observed(rover, driven, strength, generator)
    if raised:
        pitch = torch.stack([sample.pitch for sample in driven], 1).numpy()
        slower = raised * np.gradient(pitch, TIME_STEP, axis=1)  # it moves back as the nose rises
        found = [
            [
                dataclasses.replace(
                    each,
                    velocity=each.velocity - less,
                    slip=each.slip + less / (each.wheel_rate * rover.wheel_radius),
                )
                for each, less in zip(drive, slower[number].tolist(), strict=True)
            ]
            for number, drive in enumerate(found)
        ]
    return found, strength.numpy()


def simulated(
    kind: Kind,
    yaw_rate: float,
    lean: float,
    samples: int,
    constants: Tensor,
    generator: torch.Generator,
    shift: tuple[float, float] = (0.0, 0.0),
    surface: Surface | None = None,
    effects: BodyPlant | None = None,
    field: GroundField | None = None,
) -> tuple[list[BodySample], Tensor]:
    """Return the samples of all drives on ground of these ``constants`` [drives, 6].

    Also the true strength [drives, 2]. ``lean`` [deg] is the slope across which the rovers drive,
    with their heading kept. Their speed varies by a third. ``shift`` [m] moves the centre of mass
    ahead and to the left. ``surface`` is what rises above the plane, ``effects`` what is hidden,
    ``field`` how the ground differs from place to place.
    """
    rover = load_rover(kind.rover)
    chassis = Chassis.of(rover, kind.track, kind.yaw_inertia)
    x, y, height = chassis.centre
    chassis = dataclasses.replace(chassis, centre=(x + shift[0], y + shift[1], height))
    strength = Ground.random_strength(SOIL, len(constants), generator).patches[0].strength
    simulation = BodySimulation(
        chassis,
        constants,
        strength,
        Plane(0.0, math.tan(math.radians(lean))),
        surface=surface,
        effects=effects,
        field=field,
    )
    drawn = torch.rand(2, len(strength), generator=generator, dtype=torch.float64)
    frequency, phase = 0.05 + 0.1 * drawn[0], 2.0 * math.pi * drawn[1]
    driven = []
    for step in range(samples):
        sine = torch.sin(2.0 * math.pi * frequency * TIME_STEP * (step + 1) + phase)
        speed = kind.speed * (1.0 + 0.3 * sine)
        twist = torch.stack([speed, torch.zeros_like(speed), torch.full_like(speed, yaw_rate)], -1)
        if lean:
            simulation.heading = torch.zeros_like(speed)
        driven.append(simulation.step(*kind.command(chassis, twist)))
    if not bool(torch.stack([sample.solved for sample in driven]).all()):
        raise ArithmeticError(f"{kind.rover}, {yaw_rate} rad/s, {lean} deg: a step has no solution")
    return driven, strength


def _observed(
    rover: Rover, driven: Sequence[BodySample], strength: Tensor, generator: torch.Generator
) -> list[list[Observation]]:
    """Return the observations of each drive, with what tells that it is not planar."""
    measured = measure_drive(rover, _planar(rover, driven, strength), Noise(), generator)

    def stacked(place: int) -> Tensor:
        return torch.stack([sample.velocity[:, place] for sample in driven], 1)

    roll = torch.stack([sample.roll for sample in driven], 1)
    return turning_observations_of(measured, roll, stacked(1), stacked(2), generator)


def _planar(rover: Rover, driven: Sequence[BodySample], strength: Tensor) -> Sample:
    """Return a drive [drives, time, ...] as a planar rover has it: left and right are averaged."""

    def stacked(name: str) -> Tensor:
        return torch.stack([getattr(sample, name) for sample in driven], 1)

    def axles(values: Tensor) -> Tensor:
        """Return the means of left and right; the left wheels come first."""
        return values.unflatten(-1, (rover.wheels_per_axle, rover.axles)).mean(-2)  # type: ignore[no-untyped-call]

    velocity, forces = stacked("velocity")[..., 0], stacked("forces")
    before = torch.cat([torch.zeros_like(velocity[:, :1]), velocity[:, :-1]], 1)
    slip, place = axles(stacked("slip")), stacked("position")[..., 0]
    level, never = torch.zeros_like(velocity), torch.zeros_like(velocity, dtype=torch.bool)
    bogies = 2 * len(rover.suspension)  # left and right, before the differential
    normal, traction, ground_torque = (axles(forces[..., k]) for k in range(3))
    return Sample(
        time=stacked("time"),
        position=place,
        height=level,
        velocity=velocity,
        acceleration=(velocity - before) / TIME_STEP,
        pitch=stacked("pitch"),
        bogie_angle=stacked("joints")[..., :bogies].mean(-1) if bogies else level,
        stuck=never,
        standing=never,
        slip=slip,
        sinkage=axles(stacked("sinkage")),
        contact=place.unsqueeze(-1).expand_as(slip),
        contact_angle=axles(stacked("contact_angle")),
        wheel_rate=axles(stacked("rim")) / rover.wheel_radius,
        torque=axles(stacked("torque")),
        normal=normal,
        traction=traction,
        ground_torque=ground_torque,
        valid=torch.ones_like(slip, dtype=torch.bool),
        constants=SOIL.constants().expand(*slip.shape, 6),
        strength=strength[:, None, None, :].expand(*slip.shape, 2),
    )


def judge(
    model: LoadedModel, found: list[list[Observation]], strength: Floats, core: CoreConfig
) -> Judged:
    """Run the node's estimator over each drive."""
    rows = usable_rows(model.rows, core)
    inside, identified, errors, refused, shares = [], [], [], 0, []
    for observations, truth in zip(found, strength, strict=True):
        estimator = Estimator(model, core)
        updates = [estimator.update(observation) for observation in observations]
        refused += sum(each.decision.outcome is Outcome.NOT_PLANAR for each in updates)
        for each in observations:
            rim = max(each.wheel_rate) * model.rover.wheel_radius
            moved = [abs(each.lateral_velocity + x * each.yaw_rate) for x in model.rover.axle_x]
            shares.append(max(moved) / rim)
        estimate = updates[-1].estimate
        holds = (estimate.lower_95 <= truth) & (truth <= estimate.upper_95)
        inside.append(bool(holds.all()))
        identified.append(status_of(updates[-1], rows) is Status.IDENTIFIED)
        errors.append(estimate.mean / truth - 1.0)
    cohesion, friction = np.median(errors, axis=0)
    return Judged(
        sideways=float(np.median(shares)),
        refused=refused / len(shares),
        inside=sum(inside),
        identified=sum(identified),
        wrong=sum(a and not b for a, b in zip(identified, inside, strict=True)),
        error=(float(cohesion), float(friction)),
    )


HEAD = (
    "motion",
    "sideways",
    "error of c / tan phi",
    "wrong of IDENTIFIED",
    "refused",
    "wrong of IDENTIFIED, with limits",
    "holds both, with limits",
)


def lines(kind: Kind) -> Iterator[tuple[str, ...]]:
    """Yield the lines of a rover's table, one for each motion."""
    free = CoreConfig(roll_limit=0.0, turn_limit=0.0)
    with tempfile.TemporaryDirectory() as folder:
        model = physics_model(load_rover(kind.rover), [SOIL], Path(folder) / "model.pt")
    hills = f"straight, hills of {STEEP:g}°"
    motions: list[tuple[str, float, float, Waves | None, float]] = [
        ("straight, level", 0.0, 0.0, None, 0.0),
        *((f"{each:g} rad/s commanded", each, 0.0, None, 0.0) for each in kind.yaw_rates),
        *((f"across {lean:g}°", 0.0, lean, None, 0.0) for lean in LEANS),
        (hills, 0.0, 0.0, WAVELENGTHS, 0.0),
        (f"straight, bumps of {STEEP:g}°", 0.0, 0.0, BUMPS, 0.0),
        (f"{hills}, velocity {RAISED:g} m above the hubs", 0.0, 0.0, WAVELENGTHS, RAISED),
    ]
    for words, yaw_rate, lean, waves, raised in motions:
        found, strength = drives(kind, yaw_rate, lean, waves=waves, raised=raised)
        loose, held = (judge(model, found, strength, core) for core in (free, CoreConfig()))
        yield (
            words,
            f"{loose.sideways:.2f}",
            f"{100.0 * loose.error[0]:+.0f} / {100.0 * loose.error[1]:+.0f} %",
            f"{loose.wrong} of {loose.identified}",
            f"{100.0 * held.refused:.0f} %",
            f"{held.wrong} of {held.identified}",
            f"{held.inside} of {DRIVES}",
        )


def stops(
    model: LoadedModel, statics: TractionTable, found: list[list[Observation]]
) -> Counter[Reason]:
    """Return how many drives the planner stops for each reason; NONE for those it lets go on.

    As the node, it advises twice a second, with the estimate and the measurements until then.
    """
    return Counter(
        first_stop(model, statics, zip(observations, observations, strict=True))[0]
        for observations in found
    )


def first_stop(
    model: LoadedModel, statics: TractionTable, drive: Iterable[tuple[Observation, Observation]]
) -> tuple[Reason, bool]:
    """Return why the planner first stops a drive, and whether it knew margins until then.

    ``drive`` holds what the estimator and what the planner takes of each instant.
    """
    estimator = Estimator(model, CoreConfig())
    prior = model.metadata.prior_mean, model.metadata.prior_sd
    planner, known = Planner(statics, *prior, AdviceConfig()), False
    for step, (seen, for_planner) in enumerate(drive, 1):
        update = estimator.update(seen)
        planner.observe(for_planner)
        if step % ADVISED:
            continue
        planner.believe(belief_of(update))
        advice = planner.advise(seen.stamp_ns)
        if advice is not None:
            known = known or advice.known
            if advice.stop:
                return advice.reason, known
    return Reason.NONE, known


ADVISED = 5
"""Observations from one piece of advice to the next."""
STOP_HEAD = ("motion", "slip, median / 95th percentile", "stopped by SLIP", "FRONT", "others")


def stop_lines(kind: Kind) -> Iterator[tuple[str, ...]]:
    """Yield the lines of a rover's table of the planner's stops, one for each commanded turn."""
    rover = load_rover(kind.rover)
    with tempfile.TemporaryDirectory() as folder:
        model = physics_model(rover, [SOIL], Path(folder) / "model.pt")
    statics = TractionTable(rover, solve_statics(rover, (SOIL,)))
    for yaw_rate in (0.0, *kind.yaw_rates):
        found, _ = drives(kind, yaw_rate, 0.0)
        reasons = stops(model, statics, found)
        slip = np.nanquantile([each.slip.mean() for drive in found for each in drive], [0.5, 0.95])
        others = DRIVES - sum(reasons[each] for each in (Reason.NONE, Reason.SLIP, Reason.FRONT))
        yield (
            f"{yaw_rate:g} rad/s commanded" if yaw_rate else "straight",
            f"{slip[0]:.2f} / {slip[1]:.2f}",
            *(f"{reasons[each]} of {DRIVES}" for each in (Reason.SLIP, Reason.FRONT)),
            f"{others} of {DRIVES}",
        )


def main(argv: list[str] | None = None) -> int:
    """Print the tables of docs/lateral.md, or with --planner that of the planner's stops."""
    parser = study_parser("off_plane", main.__doc__)
    parser.add_argument("--planner", action="store_true", help="what the planner says in turns")
    planned = parser.parse_args(argv).planner
    head, lines_of = (STOP_HEAD, stop_lines) if planned else (HEAD, lines)
    for kind in KINDS:
        sys.stdout.write(f"{kind.rover}:\n\n{table(head, lines_of(kind))}\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
