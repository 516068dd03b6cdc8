# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a model by wheel learns from a rover that turns, and how near it comes to the bound.

make by-wheel prints the tables of docs/lateral.md. The first has the motions of off_plane, with
soil constants that are each wrong by up to 5 %; the second the drives of lateral, with exact ones,
beside their Cramer-Rao bound. All noise is that of the simulated sensors. The estimator is the
node's.
"""

import dataclasses
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from studies import lateral
from studies.command import study_parser
from studies.observations import observations_of
from studies.off_plane import (
    DRIVES,
    KINDS,
    LATERAL_SD,
    SAMPLES,
    SOIL,
    YAW_RATE_SD,
    Kind,
    simulated,
)
from studies.tables import table
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.by_wheel import ROLL_BIAS_SD, build_model_by_wheel
from terrain_estimator.learning.export import export
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Training
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.update import Update
from terramechanics.contact.rolling import WheelMotion
from terramechanics.contact.stresses import quadrature
from terramechanics.effects import EFFECTS
from terramechanics.presets import load_rover
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import TIME_STEP, Sample
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.spatial import BodySample
from terramechanics.terrain.surface import WAVELENGTHS, Surface, random_waves
from terramechanics.vehicle.body_rows import body_rows
from terramechanics.vehicle.rover import Rover, Wheel
from terramechanics.vehicle.wheel_places import WheelPlaces, wheel_order

SEED = 82_000_000
Flags = NDArray[np.bool_]
CORE = CoreConfig()
CONSTANTS_OFF = 0.05
"""[1] Each soil constant is uniform within this share of the file's."""
YAW_RATES = {"four_wheel_rover": (0.2, 0.4, 0.6), "mars_rover": (0.02, 0.05)}
"""[rad/s] commanded."""
LEANS = (6.0, 10.0, 15.0)
"""[deg] of a slope across which the rover drives."""
SHIFT = 0.01
"""[m] Error of the centre of mass ahead, and to the right."""
TYPICAL = {"four_wheel_rover": 1, "mars_rover": 1}
"""Number of the yaw rate with which other errors are tried."""
GAIN_SD = 0.1
"""[1] Deviation of an error that all torques share."""
SHOWS, DEPTH = 0.05, 0.02
"""[1], [m] Share of a wheel's load that a hidden force has, at that sinkage."""
STEEP = 5.0
"""[deg] Steepest slope of hills and bumps."""
BUMPS = (0.8, 3.0)
"""[m] Shortest and longest waves of bumps: as long as the rovers."""
ANGLE_SD = 0.05
"""[rad] Deviation of the ground from the body that is stated where no contact angle is measured.

It is three times the usual one on the bumps, 0.9 to 1.2 deg.
"""
TURNING = (0.0, 0.3, 0.6)
"""[rad/s] Largest commanded yaw rates of the drives beside the bound."""
SKID = Rover(
    name="skid",
    mass=lateral.SKID.mass,
    gravity=lateral.SKID.gravity,
    wheel_radius=lateral.SKID.wheel_radius,
    wheel_width=lateral.SKID.wheel_width,
    wheel_inertia=lateral.SKID.wheel_inertia,
    axle_x=(0.3, -0.3),
    centre_of_mass_x=0.0,
    centre_of_mass_height=lateral.SKID.centre[2],
    cruise_speed=(0.1, 0.3),
    sinkage_noise_floor=lateral.SINKAGE_FLOOR,
    wheels=tuple(
        Wheel(f"{end}_{side}", axle, side)
        for axle, end in enumerate(("front", "rear"))
        for side in ("left", "right")
    ),
)
"""The rover of lateral, whose wheels are in the order of wheel_order."""


def model_by_wheel(
    rover: Rover, places: WheelPlaces, prior: Prior, path: Path, torque_sd: tuple[float, ...] = ()
) -> LoadedModel:
    """Write the model to a file, and load it; arguments as of ``build_model_by_wheel``."""
    model = build_model_by_wheel(rover, places, [SOIL], prior, torque_sd)
    export(model, rover, [SOIL], Training(0, 0, 0.0, torch.__version__), path, places)
    return load_model(str(path))


def observed(
    rover: Rover,
    driven: Sequence[BodySample],
    strength: Tensor,
    order: Sequence[int],
    generator: torch.Generator,
    effects: BodyPlant | None = None,
    shift: float = 0.0,
) -> list[list[Observation]]:
    """Return the observations by wheel of each drive; ``order`` is that of the samples' wheels.

    ``effects`` are those of sensors; the centre of mass is ``shift`` [m] ahead of the rover file's.
    """

    def stacked(name: str) -> Tensor:
        return torch.stack([getattr(sample, name) for sample in driven], 1)

    def wheels(name: str) -> Tensor:
        return stacked(name)[:, :, order]

    velocity, slip, forces = stacked("velocity"), wheels("slip"), wheels("forces")
    before = torch.cat([torch.zeros_like(velocity[:, :1]), velocity[:, :-1]], 1)
    turned = velocity[..., 2] * TIME_STEP
    ahead = torch.cos(turned) * before[..., 0] + torch.sin(turned) * before[..., 1]
    level, never = torch.zeros_like(turned), torch.zeros_like(turned, dtype=torch.bool)
    bogies = 2 * len(rover.suspension)  # left and right, before the differential
    bogie = stacked("joints")[..., :bogies].mean(-1) if bogies else level
    sample = Sample(
        time=stacked("time"),
        position=stacked("position")[..., 0],
        height=level,
        velocity=velocity[..., 0],
        acceleration=(velocity[..., 0] - ahead) / TIME_STEP,
        pitch=stacked("pitch"),
        bogie_angle=bogie,
        stuck=never,
        standing=never,
        slip=slip,
        sinkage=wheels("sinkage"),
        contact=torch.zeros_like(slip),
        contact_angle=wheels("contact_angle"),
        wheel_rate=wheels("rim") / rover.wheel_radius,
        torque=wheels("torque"),
        normal=forces[..., 0],
        traction=forces[..., 1],
        ground_torque=forces[..., 2],
        valid=torch.isfinite(slip),
        constants=SOIL.constants().expand(*slip.shape, 6),
        strength=strength[:, None, None, :].expand(*slip.shape, 2),
    )
    sample = sample if effects is None else effects.sensed(sample)
    measured = measure_drive(rover, sample, Noise(), generator)

    def read(true: Tensor, deviation: float) -> Floats:
        noise = torch.randn(true.shape, generator=generator, dtype=torch.float64)
        return np.asarray(true + deviation * noise)

    roll = read(stacked("roll"), Noise().pitch)
    aside = velocity[..., 1] - (rover.centre_of_mass_x + shift) * velocity[..., 2]
    lateral_velocity, turn = read(aside, LATERAL_SD), read(velocity[..., 2], YAW_RATE_SD)
    steering = wheels("steering").numpy()
    return [
        [
            dataclasses.replace(
                one,
                roll=float(roll[drive, step]),
                roll_sd=Noise().pitch,
                lateral_velocity=float(lateral_velocity[drive, step]),
                lateral_velocity_sd=LATERAL_SD,
                yaw_rate=float(turn[drive, step]),
                yaw_rate_sd=YAW_RATE_SD,
                steering=steering[drive, step],
            )
            for step, one in enumerate(observations_of(measured, drive))
        ]
        for drive in range(len(strength))
    ]


@dataclasses.dataclass(frozen=True, slots=True)
class Ended:
    """What was published at the end of the drives, and the share of observations that was used."""

    updates: list[Update]
    rows: tuple[str, ...]
    used: float  # [1]
    truth: Floats  # [drives, 2]

    @property
    def mean(self) -> Floats:
        """Means of c [Pa] and tan phi [drives, 2]."""
        return np.array([each.estimate.mean for each in self.updates])

    @property
    def deviation(self) -> Floats:
        """Their deviations [drives, 2]."""
        return np.array([np.sqrt(np.diag(each.estimate.covariance)) for each in self.updates])

    @property
    def holds(self) -> Flags:
        """Whether the 95 % interval of each holds the truth [drives, 2]."""
        low = np.array([each.estimate.lower_95 for each in self.updates])
        high = np.array([each.estimate.upper_95 for each in self.updates])
        return (low <= self.truth) & (self.truth <= high)

    @property
    def identified(self) -> Flags:
        """Whether the status is IDENTIFIED [drives]."""
        return np.array([status_of(each, self.rows) is Status.IDENTIFIED for each in self.updates])


def ended(
    model: LoadedModel,
    found: list[list[Observation]],
    truth: Floats,
    core: CoreConfig = CORE,
) -> Ended:
    """Run the node's estimator over each drive."""
    updates, used, count = [], 0, 0
    for observations in found:
        estimator = Estimator(model, core)
        every = [estimator.update(observation) for observation in observations]
        used += sum(each.decision.outcome.used for each in every)
        count += len(every)
        updates.append(every[-1])
    return Ended(updates, usable_rows(model.rows, core), used / count, truth)


HEAD = (
    "motion",
    "used",
    "error of c / tan phi",
    "stated deviation",
    "c / tan phi in their interval",
    "IDENTIFIED",
    "of these wrong",
)


@dataclasses.dataclass(frozen=True, slots=True)
class Motion:
    """The drives of one line."""

    words: str
    yaw_rate: float = 0.0  # [rad/s] commanded
    lean: float = 0.0  # [deg] of the slope across
    shift: float = 0.0  # [m] of the centre of mass ahead, and to the right
    roll_sd: float = 0.0  # [rad] of a constant error of the roll
    gain_sd: float = 0.0  # [1] of an error that all torques share, which the model estimates
    sinkages: bool = True  # whether they are measured
    uneven: float = 0.0  # [deg] steepest slope of what rises above the plane
    lengths: tuple[float, float] = WAVELENGTHS  # [m] of its shortest and longest wave
    hidden: str = ""  # an effect that the estimator is not told
    angles: bool = True  # whether contact angles are measured, or ANGLE_SD is stated instead

    def but(self, words: str, **changed: Any) -> "Motion":
        """Return the motion with something else, which ``words`` say."""
        return dataclasses.replace(self, words=f"{self.words}, {words}", **changed)

    def surface(self) -> Surface | None:
        """Return what rises above the plane of each drive."""
        if not self.uneven:
            return None
        generator = torch.Generator().manual_seed(SEED + 1)
        return random_waves(DRIVES, math.radians(self.uneven), generator, self.lengths)

    def misread(self, drive: list[Observation], generator: torch.Generator) -> list[Observation]:
        """Return a drive with one draw of the constant errors."""
        bias, gain = torch.randn(2, generator=generator, dtype=torch.float64).tolist()
        return [
            dataclasses.replace(
                each,
                roll=each.roll + self.roll_sd * bias,
                torque=each.torque * (1.0 + self.gain_sd * gain),
            )
            for each in drive
        ]


def hidden_effect(name: str, rover: Rover) -> BodyPlant:
    """Return an effect of the library at a size that shows on the rover.

    Forces of it are then a twentieth of a wheel's load.
    """
    force = SHOWS * rover.weight / len(rover.wheels)
    area = rover.wheel_radius * rover.wheel_width
    sizes = {
        "slope_bias": 0.02,
        "bulldozing": force / DEPTH**2,
        "drive_drag": force * rover.wheel_radius,
        "coulomb_drag": force * rover.wheel_radius,
        "payload": SHOWS * rover.mass,
        "grousers": force,
        "slip_sinkage": 0.25,
        "multipass": 0.15,
        "odometry_scale": 0.012,
        "sinkage_bias": 0.1 * DEPTH,
        "rate_dependence": 0.15,
        "exit_angle": 0.1,
        "lateral_bulldozing": force / (DEPTH * area),
    }
    effect = EFFECTS[name]
    return BodyPlant(Plant([effect.acting(effect.values(sizes[name]))]), rover)


HIDDEN = (
    "slope_bias",
    "bulldozing",
    "drive_drag",
    "coulomb_drag",
    "payload",
    "grousers",
    "slip_sinkage",
    "multipass",
    "odometry_scale",
    "sinkage_bias",
    "rate_dependence",
    "exit_angle",
    "lateral_bulldozing",
)


def without_angles(observation: Observation) -> Observation:
    """Return an observation of a rover that does not measure contact angles."""
    none = np.full_like(observation.contact_angle, np.nan)
    return dataclasses.replace(observation, contact_angle=none, contact_angle_sd=none)


def motions(rover: str) -> list[Motion]:
    """Return the motions of a rover's table."""
    straight = Motion("straight, level")
    turns = [Motion(f"{rate:g} rad/s commanded", yaw_rate=rate) for rate in YAW_RATES[rover]]
    across = [Motion(f"across {lean:g}°", lean=lean) for lean in LEANS]
    turn, slope = turns[TYPICAL[rover]], across[1]
    off = "centre of mass off by 10 mm both ways"
    bumps = {"uneven": STEEP, "lengths": BUMPS}
    bumpy = [each.but("bumps of 5°", **bumps) for each in (straight, turn)]
    return [
        straight,
        *turns,
        *across,
        *(each.but(off, shift=SHIFT) for each in (turn, slope)),
        slope.but("roll off by 0.5°", roll_sd=ROLL_BIAS_SD),
        *(each.but("torques off by 10 %", gain_sd=GAIN_SD) for each in (straight, turn, slope)),
        *(each.but("no sinkages", sinkages=False) for each in (straight, turn, slope)),
        *(each.but("hills of 5°", uneven=STEEP) for each in (straight, turn)),
        *bumpy,
        bumpy[1].but("no contact angles", angles=False),
        bumpy[1].but("no sinkages", sinkages=False),
        bumpy[1].but("neither", angles=False, sinkages=False),
    ]


def lines(
    kind: Kind, chosen: Sequence[Motion], drives: int = DRIVES, samples: int = SAMPLES
) -> Iterator[tuple[str, ...]]:
    """Yield the lines of a rover's table, one for each of the ``chosen`` motions."""
    rover = load_rover(kind.rover)
    steered = rover.wheel_names if kind.rover == "mars_rover" else ()
    places = WheelPlaces(kind.track, kind.yaw_inertia, steered)
    order = [
        rover.wheels[k].axle + (0 if rover.wheels[k].side == "left" else rover.axles)
        for k in wheel_order(rover)
    ]
    models = {}
    with tempfile.TemporaryDirectory() as folder:
        for gain_sd in {each.gain_sd for each in chosen}:
            path = Path(folder) / "model.pt"
            torque_sd = (gain_sd,) if gain_sd else ()
            models[gain_sd] = model_by_wheel(rover, places, DEFAULT_PRIOR, path, torque_sd)
    for motion in chosen:
        generator = torch.Generator().manual_seed(SEED)
        drawn = torch.rand(DRIVES, 6, generator=generator, dtype=torch.float64)
        constants = SOIL.constants() * (1.0 + CONSTANTS_OFF * (2.0 * drawn - 1.0))
        shift = (motion.shift, -motion.shift)
        effects = hidden_effect(motion.hidden, rover) if motion.hidden else None
        driven, strength = simulated(
            kind, motion.yaw_rate, motion.lean, samples, constants, generator, shift,
            motion.surface(), effects,
        )  # fmt: skip
        found = observed(rover, driven, strength, order, generator, effects, shift[0])[:drives]
        found = [motion.misread(drive, generator) for drive in found]
        if not motion.angles:
            found = [[without_angles(each) for each in drive] for drive in found]
        core = CoreConfig(
            use_sinkage=motion.sinkages, contact_angle_sd=0.0 if motion.angles else ANGLE_SD
        )
        result = ended(models[motion.gain_sd], found, strength.numpy()[:drives], core)
        error = np.median(np.abs(result.mean / result.truth - 1.0), 0)
        spread = np.median(result.deviation / result.truth, 0)
        held, whole = result.holds.sum(0), result.identified
        outside = (whole & ~result.holds.all(1)).sum()
        yield (
            motion.words,
            f"{100.0 * result.used:.0f} %",
            f"{100.0 * error[0]:.1f} / {100.0 * error[1]:.1f} %",
            f"{100.0 * spread[0]:.1f} / {100.0 * spread[1]:.1f} %",
            f"{held[0]} / {held[1]} of {drives}",
            f"{whole.sum()}",
            f"{outside}",
        )


def information(sample: BodySample, strength: Tensor) -> lateral.Matrices:
    """Return what lateral.information does, with the errors that a model by wheel is told.

    Motion across comes from one lateral velocity and one yaw rate. Mass, centre of mass, along and
    to the left, and a constant error of the roll are four parameters more.
    """
    noise, constants = Noise(), SOIL.constants()
    slip, chassis = sample.slip, lateral.SKID
    theta = torch.cat([strength, torch.ones_like(strength[:, :1])], -1).unsqueeze(-1)
    places = torch.tensor(chassis.wheel_x, dtype=torch.float64)
    hub = sample.velocity[:, 1:2] + sample.velocity[:, 2:3] * places

    def rows(slip: Tensor, hub: Tensor, sinkage: Tensor) -> Tensor:
        motion = WheelMotion(sample.rim, sample.rim * (1.0 - slip), hub)
        return body_rows(chassis, motion, sinkage, sample.steering, constants, quadrature(6))

    def spread(value: Tensor, relative: float, floor: float) -> Tensor:
        return torch.sqrt((relative * value) ** 2 + floor**2)

    at, columns = rows(slip, hub, sample.sinkage), []
    small, none = 1e-4, torch.zeros_like(slip)
    slips = spread(slip, noise.slip_relative, noise.slip)
    sinkages = spread(sample.sinkage, noise.sinkage_relative, lateral.SINKAGE_FLOOR)
    moves = [(LATERAL_SD * torch.ones_like(hub), 1), (YAW_RATE_SD * places + none, 1)]
    for wheel in range(chassis.wheels):
        own = torch.zeros_like(slip)
        own[:, wheel] = 1.0
        moves += [(own * slips, 0), (own * sinkages, 2)]
    for step, which in moves:
        inputs = [slip, hub, sample.sinkage]
        inputs[which] = inputs[which] + small * step
        columns.append(((rows(*inputs) - at) @ theta).squeeze(-1) / small)
    jacobian = torch.stack(columns, -1)
    unit = 0.3 * chassis.wheel_radius * chassis.weight / chassis.wheels
    torque = spread(sample.forces[..., 2], noise.torque_relative, noise.torque_of_load * unit)
    rates = [
        chassis.mass * noise.velocity,
        chassis.mass * LATERAL_SD,
        chassis.yaw_inertia * YAW_RATE_SD,
        *([0.0] * (at.shape[-2] - 3)),
    ]
    by_velocity = torch.tensor(rates, dtype=torch.float64).expand(len(slip), -1) / TIME_STEP
    own = 2.0 * by_velocity**2
    tilt = chassis.weight * noise.pitch
    own = own + torch.nn.functional.pad(torque**2, [at.shape[-2] - chassis.wheels, 0])
    own[:, :2] += tilt**2
    body = torch.zeros(len(slip), at.shape[-2], 4, dtype=torch.float64)
    for parameter, row in enumerate((3, 4, 5, 1)):
        body[:, row, parameter] = -chassis.weight
    features = torch.cat([at[..., :2], body], -1)
    return features, jacobian @ jacobian.mT + own.diag_embed(), -(by_velocity**2).diag_embed()


BOUND_HEAD = (
    "commanded yaw rates",
    "used",
    "bound, c / tan phi",
    "stated deviation over the bound",
    "error over the bound's",
    "c / tan phi in their interval",
)


def bound_lines(drives: int = lateral.DRIVES) -> Iterator[tuple[str, ...]]:
    """Yield the lines of the table of drives of a minute beside their Cramer-Rao bound."""
    prior = dataclasses.replace(DEFAULT_PRIOR, constants_sd=0.0)
    places = WheelPlaces(2.0 * lateral.SKID.wheel_y[0], lateral.SKID.yaw_inertia)
    with tempfile.TemporaryDirectory() as folder:
        model = model_by_wheel(SKID, places, prior, Path(folder) / "model.pt")
    known = (
        *lateral.PRIOR_SD, prior.mass_sd, prior.centre_of_mass_sd, prior.centre_of_mass_sd,
        ROLL_BIAS_SD,
    )  # fmt: skip
    for turning in TURNING:
        samples, strength = lateral.drive(turning)
        matrices = [information(sample, strength) for sample in samples]
        rows = tuple(range(matrices[0][0].shape[-2]))
        bound = lateral.bound(matrices, rows, known)[:drives, :2].numpy()
        generator = torch.Generator().manual_seed(SEED)
        found = observed(SKID, samples, strength, range(len(SKID.wheels)), generator)[:drives]
        result = ended(model, found, strength.numpy()[:drives])
        error = np.median(np.abs(result.mean - result.truth) / result.truth, 0)
        least = np.median(bound / result.truth, 0)
        spread = np.median(result.deviation / bound, 0)
        over = error / (HALF * least)
        held = result.holds.sum(0)
        yield (
            f"to {turning:g} rad/s" if turning else "none",
            f"{100.0 * result.used:.0f} %",
            f"{100.0 * least[0]:.1f} / {100.0 * least[1]:.2f} %",
            f"{spread[0]:.2f} / {spread[1]:.2f}",
            f"{over[0]:.2f} / {over[1]:.2f}",
            f"{held[0]} / {held[1]} of {drives}",
        )


HALF = 0.6745
"""Median of the absolute value of a standard normal variable."""


def main(argv: list[str] | None = None) -> int:
    """Print the tables of docs/lateral.md about a model by wheel."""
    study_parser("by_wheel", main.__doc__).parse_args(argv)
    torch.set_num_threads(1)
    for kind in KINDS:
        chosen = motions(kind.rover)
        sys.stdout.write(f"{kind.rover}:\n\n{table(HEAD, lines(kind, chosen))}\n")
        turn = chosen[1 + TYPICAL[kind.rover]]
        hiding = [turn.but(name, hidden=name) for name in HIDDEN]
        sys.stdout.write(f"{kind.rover}, hidden:\n\n{table(HEAD, lines(kind, hiding))}\n")
        sys.stdout.flush()
    sys.stdout.write(f"skid-steer of 60 kg, 60 s:\n\n{table(BOUND_HEAD, bound_lines())}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
