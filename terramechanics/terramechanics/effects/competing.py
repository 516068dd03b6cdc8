# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""All laws that compete for a name on tables of one wheel.

Those of FURTHER stand apart from the registry: simulator and models neither have nor load them.
"""

from terramechanics.effects import Competing, depth, describe, loaded_lugs, wedges

FURTHER = {
    "bulldozing": (
        Competing(
            name="hegedus_wedge",
            unit="1",
            high=2.0,
            source="Hegedus 1960; Ishigami et al. 2007: passive pressure on a blade",
            law=wedges.HegedusWedge,
        ),
        Competing(
            name="bekker_wedge",
            unit="1",
            high=2.0,
            source="Bekker 1969, Terzaghi 1943: general shear failure ahead of a wheel",
            law=wedges.BekkerWedge,
        ),
    ),
    "grousers": (
        Competing(
            name="lug_sides",
            unit="m",
            high=0.05,
            source="Micklethwait 1944, Bekker 1969: shear along the sides of lugs",
            law=loaded_lugs.LugSides,
        ),
        Competing(
            name="spaced_lugs",
            unit="1",
            high=0.5,
            source="Terzaghi 1943, Wong 2008: passive pressure of each lug below the load",
            law=loaded_lugs.SpacedLugs,
        ),
    ),
    "slip_sinkage": (
        Competing(
            name="sinkage_growth",
            unit="1",
            high=4.0,
            source="Lyasko 2010, linear form as in Lines 2021: z = z0 (1 + S s)",
            law=depth.SinkageGrowth,
        ),
    ),
    "exit_angle": (
        Competing(
            name="exit_by_entry",
            unit="1",
            high=1.0,
            source="Pavlov and Johnson (3d-terramechanics): theta_r = theta_f (b0 + b1 s)",
            law=depth.ExitByEntry,
        ),
    ),
    "lateral_bulldozing": (
        Competing(
            name="hegedus_side",
            unit="1",
            high=2.0,
            source="Hegedus 1960; Ishigami et al. 2007, with cohesion",
            law=wedges.HegedusSide,
        ),
    ),
}
"""Laws by the name of their effect, besides those in the registry."""


def competing_laws(name: str) -> tuple[Competing, ...]:
    """Return the laws besides the registry's own. Raises ConfigError for an unknown effect."""
    return describe(name).competing + FURTHER.get(name, ())
