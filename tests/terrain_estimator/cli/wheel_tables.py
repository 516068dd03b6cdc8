# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated tables of a single wheel, and what find_missing_effect makes of them."""

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.discovery.single_wheel.cells import ROWS, Rig, Row, cells_of, wheel_alone
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import (
    ContactInputs,
    Effect,
    Situation,
    with_stiffness,
)

RADIUS, WIDTH = 0.1, 0.08
SLIPS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.65)
LOADS = (40.0, 90.0)
NOISE = (0.2e-3, 0.2, 0.1)
HEADER = "slip,normal_load_N,wheel_rate_rad_s,sinkage_mm,drawbar_pull_N,trial"
TURNED = f"{HEADER},slip_angle_deg,lateral_force_N"


class Churned(Effect):
    """Soil that softens below a slipping wheel in its exponent, unlike the library's law."""

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        del where
        return with_stiffness(contact, 1.0 / (1.0 + 8.0 * contact.slip.abs()))


class Ploughed(Effect):
    """Soil pushed by the wheel's side with Rankine's passive pressure over the chord.

    The library integrates along the rim.
    """

    def push(self, where: Situation, contact: ContactInputs, forces: torch.Tensor) -> torch.Tensor:
        if contact.slip_angle is None:
            return forces
        depth = contact.sinkage
        chord = 2.0 * torch.sqrt(2.0 * where.rover.wheel_radius * depth)
        side = (0.5 * 15e3 * 3.0 * depth**2 + 2.0 * 500.0 * 3.0**0.5 * depth) * chord
        return torch.cat(
            [
                forces[..., :3],
                forces[..., 3:] + (side * torch.sin(contact.slip_angle)).unsqueeze(-1),
            ],
            -1,
        )


def table(
    path: Path,
    effects: list[Effect],
    speeds: tuple[float, ...],
    slips: tuple[float, ...] = SLIPS,
    angles: tuple[float, ...] = (0.0,),
    lateral_offset: float = 0.0,
) -> Path:
    """Return two replicates of every setting, of a soil with constants off by 5 %.

    Slip angles are in degrees, with the carriage's slip; the lateral force is off by newtons.
    """
    generator = torch.Generator().manual_seed(3)
    soil = load_soil("loose_sand")
    bed = Rig(wheel_alone(load_rover("mars_rover"), RADIUS, WIDTH), soil, (0.05,) * 5, NOISE)
    settings = [
        (slip, load, speeds[k % len(speeds)], math.radians(angle))
        for angle in angles
        for load in LOADS
        for k, slip in enumerate(slips)
    ]
    rows = [
        Row(
            "t",
            "1",
            slip,
            load,
            speed * math.cos(angle) / RADIUS / (1.0 - slip),
            0.01,
            0.0,
            angle,
            0.0,
        )
        for slip, load, speed, angle in settings
    ]
    constants = soil.constants() * torch.tensor(
        [1.02, 1.0, 0.95, 1.05, 1.0, 1.0], dtype=torch.float64
    )
    states = bed.states(
        cells_of(rows), soil.strength().unsqueeze(0), constants.unsqueeze(0), effects
    )[0]
    states[:, ROWS.index("lateral_force")] += lateral_offset
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow((TURNED if any(angles) else HEADER).split(","))
        for row, state in zip(rows, states, strict=True):
            for trial in (1, 2):
                count = 3 if any(angles) else 2
                noise = torch.tensor(NOISE[:count]) * torch.randn(
                    count, generator=generator, dtype=torch.float64
                )
                depth, pull, *lateral = (state[:count] + noise).tolist()
                slip = 1.0 - (1.0 - row.slip) / math.cos(row.slip_angle)
                turned = [math.degrees(row.slip_angle), *lateral][: 2 * len(lateral)]
                writer.writerow(
                    [slip, row.load, row.wheel_rate, 1e3 * depth + 3.0, pull, trial, *turned]
                )
    return path


def with_slips(path: Path, folder: str, other: Callable[[float], float]) -> Path:
    """Return a table in a new folder beside this one, whose slips are other functions of these."""
    head, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
    copy = path.parent / folder / path.name
    copy.parent.mkdir()
    with copy.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([head, *([other(float(row[0])), *row[1:]] for row in rows)])
    return copy


def found(path: Path, *extra: str, lug_height: float = 0.0) -> dict[str, Any]:
    wheel = path.with_name("wheel.yaml")
    lines = ["name: testbed", f"radius: {RADIUS}", f"width: {WIDTH}", f"lug_height: {lug_height}"]
    wheel.write_text("\n".join(lines), encoding="utf-8")
    noise = [
        "--sinkage-sd",
        str(NOISE[0]),
        "--pull-sd",
        str(NOISE[1]),
        "--constants-sd",
        "0.05",
    ]
    if "lateral_force" in path.read_text(encoding="utf-8"):
        noise += ["--lateral-sd", str(NOISE[2])]
    out = path.with_suffix("")
    assert (
        main(["--wheel-table", str(path), "--wheel", str(wheel), *noise, "--out", str(out), *extra])
        == 0
    )
    content: dict[str, Any] = json.loads((out / "finding.json").read_text(encoding="utf-8"))
    return content
