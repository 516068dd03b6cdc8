# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of bags/measured, and what is stated of each laboratory's soil and readings."""

from dataclasses import dataclass
from pathlib import Path

from rover_parameters.yaml_files import load
from terrain_estimator.discovery.single_wheel.cells import (
    DATUM_SD,
    Rig,
    Row,
    TestbedWheel,
    wheel_alone,
)
from terrain_estimator.discovery.single_wheel.table import read_table
from terramechanics.presets import load_rover, load_soil

MEASURED = Path(__file__).parents[2] / "bags" / "measured"


@dataclass(frozen=True, slots=True)
class Laboratory:
    """One testbed: its soil, its wheels and what is stated of its readings."""

    name: str  # of the files
    slip_definition: str
    constants_sd: tuple[float, ...]  # of n, k, K, c1 and c2; see the page
    deviations: tuple[float, ...]  # of ROWS
    offset_sd: tuple[float, ...]  # of ROWS
    slip_sd: float
    shear_box: tuple[float, float] | None  # c [Pa] and tan phi

    def bed(self) -> Rig:
        """Return wheel and soil."""
        wheel = load(TestbedWheel, MEASURED / f"{self.name}_wheel.yaml")
        soil = load_soil(str(MEASURED / f"{self.name}_soil.yaml")).for_wheel(wheel.width)
        return Rig(
            wheel_alone(load_rover("mars_rover"), wheel.radius, wheel.width),
            soil,
            self.constants_sd,
            self.deviations,
            self.offset_sd,
            slip_sd=self.slip_sd,
        )

    def rows(self, table: str, largest_angle: float) -> list[Row]:
        """Return the rows of a table that the contact law covers."""
        path = MEASURED / f"{self.name}_{table}.csv"
        rows, _ = read_table(path, self.slip_definition, largest_angle=largest_angle)
        bed = self.bed()
        return [row for row in rows if bed.usable(row.slip, row.sinkage)]


HIT = Laboratory(
    "hit",
    "rim",
    (0.2, 0.2, 0.09, 0.5, 0.5),
    (0.5e-3, 0.5, 0.35, 0.1),
    (DATUM_SD, 2.0, 0.0, 0.3),
    0.006,
    (250.0, 0.622),
)
CMU = Laboratory(
    "cmu",
    "larger",
    (0.2, 0.2, 0.5, 0.5, 0.5),
    (0.65e-3, 0.35, 0.35, 0.02),
    (DATUM_SD, 0.0, 0.0, 0.0),
    0.0,
    None,
)


@dataclass(frozen=True, slots=True)
class Case:
    """One question to the tables of a laboratory."""

    title: str
    laboratory: Laboratory
    table: str
    reference: str = ""  # a table in which the effect does not act
    largest_angle: float = 0.0  # [deg]
    by_trial: bool = False

    @property
    def rows(self) -> list[Row]:
        """All rows, those of the reference last."""
        tables = [self.table, *filter(None, [self.reference])]
        return [row for each in tables for row in self.laboratory.rows(each, self.largest_angle)]

    @property
    def references(self) -> frozenset[str]:
        """Paths of the tables of reference."""
        path = MEASURED / f"{self.laboratory.name}_{self.reference}.csv"
        return frozenset([str(path)] if self.reference else [])


CASES = (
    Case("HIT, smooth rim", HIT, "smooth"),
    Case("HIT, 30 lugs, the smooth rim as reference", HIT, "lugs", "smooth"),
    Case("CMU, smooth, straight ahead", CMU, "smooth"),
    Case("CMU, smooth, up to 15 deg", CMU, "smooth", largest_angle=15.0),
    Case("CMU, smooth, up to 45 deg", CMU, "smooth", largest_angle=45.0),
    Case("CMU, grousers, the smooth wheel as reference", CMU, "grousers", "smooth"),
)
