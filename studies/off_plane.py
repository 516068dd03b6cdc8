# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What turns and cross slopes do to the estimator, which drives straight up and down.

python -m studies.off_plane prints the table of docs/lateral.md. Drives of 40 s on loose sand, with
the physics alone and soil constants as stated: whatever goes wrong comes from what is not planar.
"""

import math
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from studies.command import study_parser
from studies.tables import table
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.outcome import Outcome
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.spatial import BodySample, BodySimulation, Plane
from terramechanics.terrain.ground import Ground
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.steering import skid_command, steered_command
from tests.terrain_estimator.kinds import exported

Command = Callable[[Chassis, Tensor], tuple[Tensor, Tensor]]
DRIVES, SAMPLES, SEED = 24, 400, 71000000
LATERAL_SD, YAW_RATE_SD = 0.005, 0.003
"""[m/s], [rad/s] of a sample; the default deviations of messages without a variance."""
STEP_NS = 100_000_000


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


class Judged(NamedTuple):
    """What was published at the end of some drives."""

    sideways: float  # [1] median share of the rims' speed with which the furthest axle moves aside
    refused: float  # [1] share of observations that are NOT_PLANAR
    inside: int  # drives whose 95 % intervals hold c and tan phi
    identified: int
    wrong: int  # of those, with a parameter outside
    error: tuple[float, float]  # [1] median error of c and of tan phi, of the truth


def drives(
    kind: Kind, yaw_rate: float, lean: float, samples: int = SAMPLES
) -> tuple[list[list[Observation]], Floats]:
    """Return the observations of each drive, and the true strength [drives, 2].

    ``lean`` [deg] is the slope across which the rovers drive, with their heading kept. Their speed
    varies by a third.
    """
    generator = torch.Generator().manual_seed(SEED)
    noise = np.random.default_rng(SEED)
    rover, soil = load_rover(kind.rover), load_soil("loose_sand")
    chassis = Chassis.of(rover, kind.track, kind.yaw_inertia)
    strength = Ground.random_strength(soil, DRIVES, generator).patches[0].strength
    simulation = BodySimulation(
        chassis,
        soil.constants().expand(DRIVES, 6),
        strength,
        Plane(0.0, math.tan(math.radians(lean))),
    )
    drawn = torch.rand(2, DRIVES, generator=generator, dtype=torch.float64)
    frequency, phase = 0.05 + 0.1 * drawn[0], 2.0 * math.pi * drawn[1]
    found: list[list[Observation]] = [[] for _ in range(DRIVES)]
    before = torch.zeros(DRIVES, dtype=torch.float64)
    for step in range(samples):
        sine = torch.sin(2.0 * math.pi * frequency * TIME_STEP * (step + 1) + phase)
        speed = kind.speed * (1.0 + 0.3 * sine)
        turn = torch.full_like(speed, yaw_rate)
        if lean:
            simulation.heading = torch.zeros_like(speed)
        sample = simulation.step(
            *kind.command(chassis, torch.stack([speed, 0.0 * speed, turn], -1))
        )
        if not bool(sample.solved.all()):
            raise ArithmeticError(f"{kind.rover}: step {step} has no solution")
        for each, fields in zip(found, _measured(rover, sample, before, noise), strict=True):
            each.append(Observation((step + 1) * STEP_NS, *fields))  # type: ignore[arg-type]
        before = sample.velocity[:, 0]
    return found, strength.numpy()


def _measured(
    rover: Rover, sample: BodySample, before: Tensor, noise: np.random.Generator
) -> Iterator[tuple[Floats | float, ...]]:
    """Yield for each drive the fields of an observation behind its stamp."""
    sensors, wheels = Noise(), rover.wheels_per_axle
    unit = 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)

    def axles(values: Tensor) -> Floats:
        """Return the means of left and right; the left wheels come first."""
        return np.asarray(values.reshape(-1, wheels, rover.axles).mean(-2))

    def spread(values: Floats, relative: float, floor: float) -> Floats:
        return np.asarray(np.hypot(relative * values, floor) / math.sqrt(wheels))

    def seen(values: Floats, deviation: Floats | float) -> Floats:
        return np.asarray(values + deviation * noise.standard_normal(values.shape))

    slip, sinkage, torque = map(axles, (sample.slip, sample.sinkage, sample.torque))
    slip_sd = spread(slip, sensors.slip_relative, sensors.slip)
    sinkage_sd = spread(sinkage, sensors.sinkage_relative, rover.sinkage_noise_floor)
    torque_sd = spread(torque, sensors.torque_relative, sensors.torque_of_load * unit)
    angle_sd = np.full_like(slip, sensors.contact_angle)
    velocity, lateral, turn = (each.numpy() for each in sample.velocity.unbind(-1))
    specific = (sample.velocity[:, 0] - before) / TIME_STEP - sample.gravity[:, 0]
    by_axle = (
        (seen(slip, slip_sd), slip_sd),
        (seen(sinkage, sinkage_sd), sinkage_sd),
        (seen(np.zeros_like(slip), angle_sd), angle_sd),
        (axles(sample.rim) / rover.wheel_radius,),
        (seen(torque, torque_sd), torque_sd),
    )
    by_body = (
        (seen(velocity, sensors.velocity), sensors.velocity),
        (seen(sample.pitch.numpy(), sensors.pitch), sensors.pitch),
        (seen(specific.numpy(), sensors.acceleration), sensors.acceleration),
        (np.zeros(DRIVES), seen(sample.roll.numpy(), sensors.pitch)),
        (seen(lateral, LATERAL_SD), LATERAL_SD),
        (seen(turn, YAW_RATE_SD), YAW_RATE_SD),
    )
    columns = [each for group in (*by_axle, *by_body) for each in group]
    for drive in range(DRIVES):
        yield tuple(each if isinstance(each, float) else each[drive] for each in columns)


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


def lines() -> Iterator[tuple[str, ...]]:
    """Yield the lines of the table, one for each motion of each rover."""
    free = CoreConfig(roll_limit=0.0, turn_limit=0.0)
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as folder:
            model = load_model(str(exported(load_rover(kind.rover), Path(folder))))
        motions = [(0.0, 0.0), *((each, 0.0) for each in kind.yaw_rates)]
        motions += [(0.0, lean) for lean in LEANS]
        for yaw_rate, lean in motions:
            found, strength = drives(kind, yaw_rate, lean)
            loose, held = (judge(model, found, strength, core) for core in (free, CoreConfig()))
            yield (
                kind.rover,
                f"{yaw_rate:g}",
                f"{lean:g}",
                f"{loose.sideways:.3f}",
                f"{100.0 * loose.error[0]:+.0f} / {100.0 * loose.error[1]:+.0f}",
                f"{loose.inside}",
                f"{loose.wrong} of {loose.identified}",
                f"{100.0 * held.refused:.0f}",
                f"{held.inside}",
                f"{held.wrong} of {held.identified}",
            )


def main(argv: list[str] | None = None) -> int:
    """Print the table of docs/lateral.md."""
    study_parser("off_plane", main.__doc__).parse_args(argv)
    head = (
        "rover",
        "yaw rate",
        "lean",
        "sideways",
        "error of c / tan phi",
        "inside",
        "wrong",
        "refused",
        "inside, with limits",
        "wrong, with limits",
    )
    sys.stdout.write(table(head, []))
    for line in lines():
        sys.stdout.write(table(line, []).splitlines()[0] + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
