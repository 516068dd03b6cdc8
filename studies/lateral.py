# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How well a minute of skid steering could tell c and tan(phi): the Cramer-Rao bound.

python -m studies.lateral prints the tables of docs/lateral.md.

Information at the true strength and inputs, soil constants exact. A sample at 10 Hz has a row for
each balance and each torque. The noise of slip along and across and of sinkage is propagated into
all rows of its sample; neighbouring rows of v and omega share a measured velocity, so that the
noise of a whole drive is block tridiagonal.
"""

import math

import torch
from torch import Tensor

from studies.command import study_parser
from studies.tables import table
from terramechanics.contact.rolling import WheelMotion
from terramechanics.contact.stresses import quadrature
from terramechanics.presets import load_soil
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.spatial import BodySample, BodySimulation, Plane
from terramechanics.terrain.ground import Ground
from terramechanics.vehicle.body_rows import body_rows
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.steering import skid_command

DRIVES, SAMPLES, SEED = 24, 600, 53000000
SINKAGE_FLOOR = 3e-4
"""[m] Constant part of the sinkage's deviation, that of the Mars-like rover."""
YAW_RATE_SD = 0.01
"""[rad/s] of a sample of the yaw rate."""
PRIOR_SD = (1300.0, 0.21)
"""c [Pa] and tan(phi) [1]: of what the drives are drawn from, 0.5 to 5 kPa and 15 to 45 deg."""
SKID = Chassis(
    name="four-wheel skid-steer",
    mass=60.0,
    yaw_inertia=6.0,
    gravity=9.81,
    wheel_radius=0.165,
    wheel_width=0.12,
    wheel_inertia=0.02,
    wheel_x=(0.3, 0.3, -0.3, -0.3),
    wheel_y=(0.28, -0.28, 0.28, -0.28),
    centre=(0.0, 0.0, 0.25),
)
MEASURED = {
    "v": (0, 1),
    "v + omega": (0, 1, 2),
    "v + omega + load": (0, 1, 2, 3),
    "v + omega + load + moments": (0, 1, 2, 3, 4, 5),
    "v + omega + load + moments + torque": tuple(range(10)),
}
"""Rows of :func:`body_rows` by what is measured: load and moments need nothing beside the pose."""
Matrices = tuple[Tensor, Tensor, Tensor]


def twists(turning: float, generator: torch.Generator) -> Tensor:
    """Return commanded twists [time, drives, 3]: sums of two sines, yaw rates to ``turning``."""
    time = TIME_STEP * torch.arange(1, SAMPLES + 1, dtype=torch.float64).view(-1, 1, 1)
    drawn = torch.rand(3, 1, DRIVES, 4, generator=generator, dtype=torch.float64)
    frequency, phase = 0.03 + 0.09 * drawn[0], 2.0 * math.pi * drawn[1]
    sines = torch.sin(2.0 * math.pi * frequency * time + phase)
    speed = (0.12 + 0.12 * drawn[2, ..., 0]) * (
        1.0 + 0.25 * (0.6 * sines[..., 0] + 0.4 * sines[..., 1])
    )
    yaw = turning * (0.6 * sines[..., 2] + 0.4 * sines[..., 3])
    return torch.stack([speed, torch.zeros_like(yaw), yaw], -1)


def drive(turning: float) -> tuple[list[BodySample], Tensor]:
    """Return the samples of all drives on loose sand and slopes to 5 deg, and their strength."""
    generator = torch.Generator().manual_seed(SEED)
    soil = load_soil("loose_sand")
    strength = Ground.random_strength(soil, DRIVES, generator).patches[0].strength
    slopes = 2.0 * torch.rand(2, DRIVES, generator=generator, dtype=torch.float64) - 1.0
    plane = Plane(*(math.tan(math.radians(5.0)) / math.sqrt(2.0) * slopes))
    simulation = BodySimulation(SKID, soil.constants().expand(DRIVES, 6), strength, plane)
    samples = [simulation.step(*skid_command(SKID, each)) for each in twists(turning, generator)]
    return samples, strength


def information(sample: BodySample, strength: Tensor) -> Matrices:
    """Return features [drives, 10, 2], covariance of a sample alone, and of it with the next.

    The covariances are [drives, 10, 10].
    """
    noise, constants = Noise(), load_soil("loose_sand").constants()
    slip, lateral = sample.slip, sample.across / sample.rim
    theta = torch.cat([strength, torch.ones_like(strength[:, :1])], -1).unsqueeze(-1)

    def rows(slip: Tensor, lateral: Tensor, sinkage: Tensor) -> Tensor:
        motion = WheelMotion(sample.rim, sample.rim * (1.0 - slip), sample.rim * lateral)
        return body_rows(SKID, motion, sinkage, sample.steering, constants, quadrature(6))

    def spread(value: Tensor, relative: float, floor: float) -> Tensor:
        return torch.sqrt((relative * value) ** 2 + floor**2)

    inputs = [slip, lateral, sample.sinkage]
    spreads = [
        spread(slip, noise.slip_relative, noise.slip),
        spread(lateral, noise.slip_relative, noise.slip),
        spread(sample.sinkage, noise.sinkage_relative, SINKAGE_FLOOR),
    ]
    at, columns = rows(*inputs), []
    for which in range(3):
        for wheel in range(SKID.wheels):
            step = torch.zeros_like(slip)
            step[:, wheel] = 1e-4 * spreads[which][:, wheel]
            moved = [value + step if k == which else value for k, value in enumerate(inputs)]
            columns.append(((rows(*moved) - at) @ theta).squeeze(-1) * 1e4)
    jacobian = torch.stack(columns, -1)
    unit = 0.3 * SKID.wheel_radius * SKID.weight / SKID.wheels
    torque = spread(sample.forces[..., 2], noise.torque_relative, noise.torque_of_load * unit)
    by_velocity = torch.zeros(slip.shape[0], 10, dtype=torch.float64)
    by_velocity[:, :2] = SKID.mass / TIME_STEP * noise.velocity
    by_velocity[:, 2] = SKID.yaw_inertia / TIME_STEP * YAW_RATE_SD
    own = 2.0 * by_velocity**2
    own[:, 6:] = torque**2
    # Gravity along the body is known by pitch and roll.
    tilt = SKID.weight * noise.pitch
    own[:, :2] += tilt**2
    alone = jacobian @ jacobian.mT + own.diag_embed()
    return at[..., :2], alone, -(by_velocity**2).diag_embed()


def bound(
    matrices: list[Matrices], rows: tuple[int, ...], prior: tuple[float, ...] = PRIOR_SD
) -> Tensor:
    """Return the deviations of c [Pa] and tan(phi) [drives, 2] after the samples, prior added.

    With further parameters ``prior`` has theirs, too. Forward elimination of the block tridiagonal
    covariance, sample by sample.
    """
    chosen = torch.tensor(rows)
    total = torch.diag(torch.tensor(prior, dtype=torch.float64) ** -2.0)
    before: tuple[Tensor, Tensor] | None = None
    for features, alone, link in matrices:
        column, covariance = features[:, chosen], alone[:, chosen][:, :, chosen]
        shared = link[:, chosen][:, :, chosen]
        if before is not None:
            last_column, last = before
            column = column - shared @ torch.linalg.solve(last, last_column)
            covariance = covariance - shared @ torch.linalg.solve(last, shared)
        total = total + column.mT @ torch.linalg.solve(covariance, column)
        before = column, covariance
    return torch.linalg.inv(total).diagonal(dim1=-2, dim2=-1).sqrt()


def main(argv: list[str] | None = None) -> int:
    """Print the tables of docs/lateral.md."""
    study_parser("lateral", main.__doc__).parse_args(argv)
    for title, turning in (("with turns", 0.6), ("straight ahead", 0.0)):
        samples, strength = drive(turning)
        solved = torch.stack([sample.solved for sample in samples]).double().mean()
        slip = torch.stack([sample.slip for sample in samples])
        yaw = torch.stack([sample.velocity[:, 2] for sample in samples]).abs()
        matrices = [information(sample, strength) for sample in samples]
        lines = []
        for name, rows in MEASURED.items():
            deviation = 100.0 * (bound(matrices, rows) / strength).median(0).values
            lines.append((name, f"{float(deviation[0]):.1f}", f"{float(deviation[1]):.2f}"))
        print(
            f"{title}: solved {float(solved):.4f}, median slip {float(slip.median()):.2f}, median"
            f" yaw rate {float(yaw.median()):.3f} rad/s\n"
        )
        print(table(("measured", "c [%]", "tan phi [%]"), lines))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
