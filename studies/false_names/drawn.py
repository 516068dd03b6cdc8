# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Tables as laboratories make them, drawn at random, of wheels foreign to the library."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from studies.false_names.wheel import DISTRIBUTIONS, PRESSURES, SHEARS, Extra, Soil, Wheel
from terrain_estimator.discovery.single_wheel.cells import DATUM_SD, Rig, Row, wheel_alone
from terrain_estimator.observation import Floats
from terramechanics.presets import load_rover
from terramechanics.terrain.soil import Soil as StatedSoil

TESTED, COMPARED = "table.csv", "reference.csv"
HIDDEN = ("tip", "passive", "spaced", "digging", "wedge")
"""What a table may hide; the family of each is that of FAMILIES."""
FAMILIES = {
    "tip": "grousers",
    "passive": "grousers",
    "spaced": "grousers",
    "digging": "slip_sinkage",
    "wedge": "bulldozing",
}


@dataclass(frozen=True, slots=True)
class Drawn:
    """Tables of one laboratory, and what is stated of them."""

    bed: Rig
    rows: tuple[Row, ...]
    reference: frozenset[str]
    plain: Wheel  # the truth without what is hidden
    tested: Wheel  # and with it

    @property
    def soil(self) -> Soil:
        """The true soil."""
        return self.plain.soil


def draw(generator: np.random.Generator, hidden: str = "") -> Drawn:
    """Return the tables of one laboratory; an effect that is hidden has a reference without it."""
    soil = _soil(generator)
    radius = generator.uniform(0.05, 0.2)
    plain = Wheel(radius, radius * generator.uniform(0.4, 1.1), soil)
    load = plain.forces(0.1, radius * generator.uniform(0.05, 0.2))[0]
    wheels = {TESTED: replace(plain, extra=_extra(generator, hidden, plain, load))}
    if hidden or generator.random() < 0.5:
        wheels[COMPARED] = plain
    bed = _bed(generator, plain, load)
    zeros = np.array(bed.offset_sd) * generator.standard_normal(4)
    settings = _settings(generator, load)
    rows = [
        row
        for name, wheel in wheels.items()
        for row in _rows(generator, bed, name, wheel, settings, zeros)
    ]
    kept = tuple(row for row in rows if bed.usable(row.slip, row.sinkage))
    return Drawn(bed, kept, frozenset(wheels) - {TESTED}, plain, wheels[TESTED])


def _soil(generator: np.random.Generator) -> Soil:
    depth = generator.uniform(0.01, 0.03)
    return Soil(
        pressure=str(generator.choice(PRESSURES)),
        shear=str(generator.choice(SHEARS)),
        distribution=str(generator.choice(DISTRIBUTIONS)),
        n=generator.uniform(0.6, 1.4),
        stiffness=math.exp(generator.uniform(math.log(5e3), math.log(6e4))),
        depth=depth,
        bend=depth * generator.uniform(0.3, 2.0),
        crust=generator.uniform(0.3, 1.0),
        shear_length=math.exp(generator.uniform(math.log(3e-3), math.log(0.025))),
        peak=generator.uniform(0.1, 0.5),
        c1=generator.uniform(0.2, 0.5),
        c2=generator.uniform(0.0, 0.35),
        exit_share=generator.uniform(0.05, 0.3),
        cohesion_pa=generator.uniform(0.0, 3e3),
        tan_phi=generator.uniform(0.4, 0.8),
    )


def _extra(generator: np.random.Generator, hidden: str, wheel: Wheel, load: float) -> Extra:
    """Return what is hidden, with sizes in shares of load or radius that laboratories report."""
    large = generator.uniform(0.08, 0.25) * load
    depth = wheel.state(0.3, load)[0]
    ahead = math.acos(1.0 - depth / wheel.radius)
    return {
        "": Extra(),
        "tip": Extra(tip=generator.uniform(0.08, 0.2) * wheel.radius),
        "passive": Extra(passive_n=large, passive_slip=generator.uniform(0.05, 0.25)),
        "spaced": Extra(
            spaced_pa=large / (wheel.width * wheel.radius * ahead),
            spaced_slip=generator.uniform(0.15, 0.5),
        ),
        "digging": Extra(digging=generator.uniform(0.5, 2.0)),
        "wedge": Extra(wedge_pa_m=large / (wheel.width * depth**2)),
    }[hidden]


def _settings(generator: np.random.Generator, load: float) -> list[tuple[float, float, float]]:
    """Return slip, load [N] and wheel rate [rad/s] of each setting."""
    slips = generator.choice((0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8), 6, replace=False)
    loads = load * np.array((1.0,) if generator.random() < 0.6 else (0.6, 1.4))
    rate = generator.uniform(0.1, 1.0)
    one_speed = generator.random() < 0.6  # of the carriage; else the wheel's rate is constant
    return [
        (slip, each, rate / (1.0 - slip) if one_speed else rate)
        for each in loads.tolist()
        for slip in sorted(slips.tolist())
    ]


def _bed(generator: np.random.Generator, wheel: Wheel, load: float) -> Rig:
    """Return what the laboratory states: plates and a shear box on its soil, and its readings."""
    soil = wheel.soil
    depths = np.linspace(0.3, 1.5, 8) * soil.depth
    n, level = np.polyfit(np.log(depths), np.log(soil.pressed(depths)), 1)
    shear = np.linspace(0.1, 4.0, 12) * soil.shear_length
    share = soil.mobilised(shear)
    tried = soil.shear_length * np.geomspace(0.2, 5.0, 200)
    best = tried[
        np.argmin([((-np.expm1(-shear / each) - share / share.max()) ** 2).sum() for each in tried])
    ]
    off = np.exp(0.15 * generator.standard_normal(3))
    stated = StatedSoil(
        "stated",
        n=float(np.clip(n * off[0], 0.2, 2.5)),
        k_c=0.0,
        k_phi=float(math.exp(level) * off[1]),
        shear_modulus=float(best * off[2]),
        c1=0.3,
        c2=0.2,
        cohesion=500.0,
        tan_phi=0.6,
    )
    zero_known = generator.random() < 0.5
    deviations = (
        generator.uniform(0.3e-3, 1.0e-3),
        generator.uniform(0.005, 0.015) * load,
        1.0,
        generator.uniform(0.005, 0.015) * load * wheel.radius,
    )
    offsets = (DATUM_SD, 0.0, 0.0, 0.0)
    if not zero_known:
        offsets = (DATUM_SD, 0.02 * load, 0.0, 0.02 * load * wheel.radius)
    slip_sd = 0.0 if generator.random() < 0.5 else 0.006
    return Rig(
        wheel_alone(load_rover("mars_rover"), wheel.radius, wheel.width),
        stated,
        (0.15, 0.15, 0.15, 0.5, 0.5),
        deviations,
        offsets,
        slip_sd=slip_sd,
    )


def _rows(
    generator: np.random.Generator,
    bed: Rig,
    name: str,
    wheel: Wheel,
    settings: Sequence[tuple[float, float, float]],
    zeros: Floats,
) -> list[Row]:
    """Return the table of one wheel, read with errors as stated."""
    found = []
    for slip, load, rate in settings:
        true = slip + bed.slip_sd * float(generator.standard_normal())
        depth, pull, torque = wheel.state(true, load)
        noise = np.array(bed.deviations) * generator.standard_normal(4) + zeros
        found.append(
            Row(
                *(name, "1", slip, load, rate),
                sinkage=depth + float(noise[0]),
                drawbar_pull=pull + float(noise[1]),
                torque=torque + float(noise[3]),
            )
        )
    return found
