# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The worlds of the study: one thing in each that the estimator is not told."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.learning.tasks import SOILS
from terramechanics.simulation.sample import Measurement, Sample
from terramechanics.simulation.sensors import Noise, coloured, measure_drive
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.vehicle.rover import Rover
from tests.hidden.generators import GENERATORS

(
    AS_MODELLED,
    RATE,
    OWN_ROVER,
    VARYING,
    EFFECT,
    OUTSIDE,
    NOISE,
    ODOMETRY,
    SOIL,
    ROVER,
    TOGETHER,
) = (
    "nothing hidden",
    "other rates",
    "other rovers",
    "varying ground",
    "hidden effects",
    "effects outside the library",
    "misstated noise",
    "drifting odometry",
    "unknown soil",
    "misstated rover",
    "all together",
)
"""Kinds of worlds, as the page names them."""
SECONDS = 60.0
BATCH = 20
"""Drives that are computed at once, in one world."""
SOIL_RANGES = (
    (0.5, 1.3),  # n [1]
    (500.0, 2000.0),  # k_c [Pa/m^(n-1)]
    (0.6e6, 2.0e6),  # k_phi [Pa/m^n]
    (0.012, 0.045),  # K [m]
    (0.15, 0.45),  # c1 [1]
    (0.1, 0.35),  # c2 [1]
)
"""Constants of an unknown soil: those of the three soils that the model knows span most of it."""
ROVER_SPREAD = 0.3
"""[1] Largest change of the mass and of the wheels' radius and width of a rover."""
VARIATION_M = 0.3
"""[m] Distance after which the deviations of varying ground are drawn anew, linear between."""
DRIFT_S = 10.0
"""[s] Time constant of an odometry's drift."""


@dataclass(frozen=True, slots=True)
class World:
    """What is hidden from the estimator."""

    kind: str
    name: str
    parts: tuple[tuple[str, float], ...] = ()  # effects, each with a share of the size that matters
    noise: float = 1.0  # times what is stated
    noise_time: float = 0.0  # [s] time constant of the noise, 0: white
    steps: float = 0.0  # width of a reading's steps, in stated deviations
    drift: float = 0.0  # deviation of the odometry's drift, of the velocity
    drifting_slip: bool = False  # slip is computed from such a velocity
    rate_hz: float = 10.0  # of the readings
    soil: str = "loose_sand"  # empty: an unknown one
    rover: bool = False  # a misstated one
    near: str = ""  # a preset: the rover is near it, and its file and model are its own
    variation: float = 0.0  # relative deviation of c, tan phi and the stiffness along the way
    told_variation: float = 0.0  # the same as the model has it, in a model of its own


def worlds() -> list[World]:
    """Return every world in the order of the page."""
    library = [name for name, hidden in GENERATORS.items() if hidden.known]
    others = [name for name, hidden in GENERATORS.items() if not hidden.known]
    return [
        *(World(AS_MODELLED, soil, soil=soil) for soil in SOILS),
        *(World(RATE, f"{rate:g} Hz", rate_hz=rate) for rate in (5.0, 20.0, 50.0, 200.0)),
        *(
            World(OWN_ROVER, f"within 30 % of {preset}", near=preset)
            for preset in ("mars_rover", "paper_rover")
        ),
        *(
            World(VARYING, _varying_name(share, told), variation=share, told_variation=told)
            for told, share in (
                *((0.0, each) for each in (0.01, 0.02, 0.05)),
                *((0.02, each) for each in (0.0, 0.01, 0.02)),
                (0.05, 0.05),
            )
        ),
        *(World(EFFECT, name, ((name, 1.0),)) for name in library),
        *(World(OUTSIDE, name, ((name, 1.0),)) for name in others),
        World(NOISE, "half of what is stated", noise=0.5),
        World(NOISE, "twice what is stated", noise=2.0),
        World(NOISE, "three times what is stated", noise=3.0),
        World(NOISE, "correlated over 0.5 s", noise_time=0.5),
        World(NOISE, "steps of two deviations", steps=2.0),
        *(
            World(ODOMETRY, f"{what} off by {100 * drift:g} %", drift=drift, drifting_slip=both)
            for drift in (0.02, 0.05)
            for both, what in ((False, "velocity"), (True, "velocity and slip"))
        ),
        World(SOIL, "constants drawn", soil=""),
        World(ROVER, "mass, radius, width up to 30 % off", rover=True),
    ]


def _varying_name(share: float, told: float) -> str:
    """Return the name of a world whose ground varies by ``share``."""
    return f"by {100 * share:g} %" + (f", model for {100 * told:g} %" if told else "")


def together(generator: torch.Generator) -> World:
    """Draw a world in which everything is hidden at once."""
    names = list(GENERATORS)
    share, noise = torch.rand(2, generator=generator, dtype=torch.float64).tolist()
    coloured, stepped = (torch.rand(2, generator=generator) < 0.5).tolist()
    name = names[int(torch.randint(len(names), (1,), generator=generator))]
    return World(
        TOGETHER,
        TOGETHER,
        ((name, 1.5 * share),),
        noise=0.5 * 6.0**noise,
        noise_time=0.5 if coloured else 0.0,
        steps=2.0 if stepped else 0.0,
        soil="",
        rover=True,
    )


def unknown_ground(strength: Tensor, generator: torch.Generator) -> Ground:
    """Return ground of this strength [N, 2] whose constants are drawn from SOIL_RANGES."""
    low, high = torch.tensor(SOIL_RANGES, dtype=torch.float64).unbind(1)
    share = torch.rand((strength.shape[0], len(low)), generator=generator, dtype=torch.float64)
    return Ground([Patch(low + (high - low) * share, strength)])


def varying_ground(
    mean: Patch, share: float, length_m: float, generator: torch.Generator
) -> Ground:
    """Return ground that varies along ``length_m`` [m] about ``mean``, strength [N, 2].

    c, tan phi and the stiffness deviate by ``share``, at most by 2.5 times that.
    """
    drives = mean.strength.shape[0]
    patches: list[Patch] = []
    start = -VARIATION_M
    while start < length_m:
        draw = torch.randn(drives, 3, generator=generator, dtype=torch.float64).clamp(-2.5, 2.5)
        factor = 1.0 + share * draw
        stiffer = torch.ones_like(mean.constants)
        stiffer[:, 1:3] = factor[:, 2:]  # k_c and k_phi
        transition = VARIATION_M if patches else 0.0
        patches.append(
            Patch(mean.constants * stiffer, mean.strength * factor[:, :2], start, transition)
        )
        start += VARIATION_M
    return Ground(patches)


def rover_near(rover: Rover, generator: torch.Generator) -> Rover:
    """Return a rover whose mass and wheels differ by up to ROVER_SPREAD."""
    draw = torch.rand(3, generator=generator, dtype=torch.float64)
    mass, radius, width = (1.0 + ROVER_SPREAD * (2.0 * draw - 1.0)).tolist()
    return dataclasses.replace(
        rover,
        mass=mass * rover.mass,
        wheel_radius=radius * rover.wheel_radius,
        wheel_width=width * rover.wheel_width,
    )


def measured(world: World, rover: Rover, sample: Sample, generator: torch.Generator) -> Measurement:
    """Measure a batch of drives with the world's noise, but the usual stated deviations."""
    correlation = math.exp(-1.0 / (world.rate_hz * world.noise_time)) if world.noise_time else 0.0
    noise = Noise(factor=world.noise)
    found = measure_drive(rover, sample, noise, generator, correlation)
    values = {item.name: getattr(found, item.name) for item in dataclasses.fields(Measurement)}
    for name in [name for name in values if name.endswith("_sd")]:
        values[name] = values[name] / world.noise
        signal = name.removesuffix("_sd")
        if world.steps and signal != "acceleration":  # whose deviation holds a constant bias, too
            width = world.steps * values[name].amin((0, 1))
            values[signal] = torch.round(values[signal] / width) * width
    if world.drift:
        share = world.drift * drift_of(sample.velocity.shape, 1.0 / world.rate_hz, generator)
        values["velocity"] = values["velocity"] + share * sample.velocity
        if world.drifting_slip:
            rolling = 1.0 - sample.slip
            values["slip"] = values["slip"] - share.unsqueeze(-1) * rolling
    return Measurement(**values)


def drift_of(shape: Sequence[int], time_step: float, generator: torch.Generator) -> Tensor:
    """Return series [batch, time] of deviation 1, correlated over DRIFT_S; ``time_step`` [s]."""
    white = torch.randn(shape, generator=generator, dtype=torch.float64)
    return coloured(white, math.exp(-time_step / DRIFT_S))
