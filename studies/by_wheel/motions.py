# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The motions, the ground and the hidden effects of the tables, and the lines of these."""

import dataclasses
import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from studies.by_wheel.drives import SEED, compiled, ended, model_by_wheel
from studies.off_plane import (
    BUMPS,
    DRIVES,
    SAMPLES,
    SOIL,
    STEEP,
    Kind,
    simulated,
)
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.learning.by_wheel import ROLL_BIAS_SD
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.observation import Observation
from terramechanics.effects import EFFECTS
from terramechanics.presets import load_rover
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.spatial import BodySample
from terramechanics.terrain.surface import WAVELENGTHS, Surface, random_waves
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.steering import steered_command
from terramechanics.vehicle.wheel_places import WheelPlaces, chassis_places, wheel_order

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
ANGLE_SD = 0.05
"""[rad] Deviation of the ground from the body that is stated where no contact angle is measured.

It is three times the usual one on the bumps, 0.9 to 1.2 deg.
"""


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
    torques: bool = True  # whether they are
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

    Forces of it are then about a twentieth of a wheel's load.
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


def without_torques(observation: Observation) -> Observation:
    """Return an observation of a rover that does not measure torques."""
    none = np.full_like(observation.torque, np.nan)
    return dataclasses.replace(observation, torque=none, torque_sd=none)


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
        *(each.but("no torques", torques=False) for each in (straight, turn, slope)),
        *(each.but("hills of 5°", uneven=STEEP) for each in (straight, turn)),
        *bumpy,
        bumpy[1].but("no contact angles", angles=False),
        bumpy[1].but("no sinkages", sinkages=False),
        bumpy[1].but("neither", angles=False, sinkages=False),
    ]


def driven_of(
    kind: Kind, motion: Motion, samples: int, effects: BodyPlant | None = None
) -> tuple[list[BodySample], Tensor, Tensor, torch.Generator]:
    """Return the samples of all drives of a motion, their strength [drives, 2] and soil constants.

    The constants are [drives, 6]; the generator is that of the sensors' noise.
    """
    generator = torch.Generator().manual_seed(SEED)
    drawn = torch.rand(DRIVES, 6, generator=generator, dtype=torch.float64)
    constants = SOIL.constants() * (1.0 + CONSTANTS_OFF * (2.0 * drawn - 1.0))
    driven, strength = simulated(
        kind, motion.yaw_rate, motion.lean, samples, constants, generator,
        (motion.shift, -motion.shift), motion.surface(), effects,
    )  # fmt: skip
    return driven, strength, constants, generator


def lines(
    kind: Kind,
    chosen: Sequence[Motion],
    drives: int = DRIVES,
    samples: int = SAMPLES,
    *,
    compile_core: bool = False,
) -> Iterator[tuple[str, ...]]:
    """Yield the lines of a rover's table, one for each of the ``chosen`` motions.

    With ``compile_core`` the models are compiled before, which pays for long drives.
    """
    rover = load_rover(kind.rover)
    steered = rover.wheel_names if kind.command is steered_command else ()
    places = WheelPlaces(kind.track, kind.yaw_inertia, steered)
    in_chassis = chassis_places(rover)
    order = [in_chassis[k] for k in wheel_order(rover)]
    models = {}
    with tempfile.TemporaryDirectory() as folder:
        for gain_sd in {each.gain_sd for each in chosen}:
            path = Path(folder) / "model.pt"
            torque_sd = (gain_sd,) if gain_sd else ()
            models[gain_sd] = model_by_wheel(rover, places, DEFAULT_PRIOR, path, torque_sd)
            if compile_core:
                models[gain_sd] = compiled(path)
    for motion in chosen:
        effects = hidden_effect(motion.hidden, rover) if motion.hidden else None
        driven, strength, _, generator = driven_of(kind, motion, samples, effects)
        found = observed(rover, driven, order, generator, effects, motion.shift)[:drives]
        found = [motion.misread(drive, generator) for drive in found]
        if not motion.angles:
            found = [[without_angles(each) for each in drive] for drive in found]
        if not motion.torques:
            found = [[without_torques(each) for each in drive] for drive in found]
        core = CoreConfig(
            use_sinkage=motion.sinkages,
            contact_angle_sd=0.0 if motion.angles else ANGLE_SD,
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
