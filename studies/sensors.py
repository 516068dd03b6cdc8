# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What each sensor is worth: error and interval of c and tan phi by what a rover measures.

python -m studies.sensors prints the table of docs/bring_your_own_sensors.md. Drives S1 of 40 s on
loose sand, with the physics alone, soil constants wrong by up to 5 % and truths from the prior. The
bound without sinkages takes them as unknown: their deviation is ten times their size. Contact
angles that are not measured are taken to be along body and bogie, as the estimator does with
contact_angle_sd.
"""

import dataclasses
import math
import sys
from typing import NamedTuple

import torch
from torch import Tensor

from studies.accuracy.scores import (
    FROM_PRIOR,
    CellScore,
    MeasuredDrives,
    draw_drives,
    judge,
    observation_times,
    score,
)
from studies.batched import run
from studies.bound import Known, cramer_rao_at
from studies.command import study_parser
from studies.tables import table
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.learning.tasks import CONSTANTS_SPREAD
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.row_names import row_names
from terramechanics.presets import load_rover, load_soil

ROVERS, SOIL = ("paper_rover", "mars_rover", "four_wheel_rover"), "loose_sand"
DRIVES, SEED = 100, 73_000_000
TIMES_S = (40.0,)
UNKNOWN = 10.0
"""[1] Deviation of an unknown sinkage, of the sinkage."""


class Sensors(NamedTuple):
    """What a rover measures beside velocity, slip and pitch."""

    name: str
    sinkage: bool
    torque: bool
    moments: bool  # with a bogie its angle, without one nothing
    contact_angle: bool = True


SETS = (
    Sensors("sinkage, torque, moments", sinkage=True, torque=True, moments=True),
    Sensors("sinkage, torque", sinkage=True, torque=True, moments=False),
    Sensors("sinkage, moments", sinkage=True, torque=False, moments=True),
    Sensors("sinkage", sinkage=True, torque=False, moments=False),
    Sensors("torque, moments", sinkage=False, torque=True, moments=True),
    Sensors(
        "sinkage, torque, moments; no contact angle",
        sinkage=True,
        torque=True,
        moments=True,
        contact_angle=False,
    ),
    Sensors(
        "torque, moments; no contact angle",
        sinkage=False,
        torque=True,
        moments=True,
        contact_angle=False,
    ),
)
SUPPOSED_SD = 0.03
"""[rad] Stated deviation of contact angles that are taken to be along body and bogie."""


def mask(sensors: Sensors, axles: int) -> Tensor:
    """Return 1 for the rows [R] that these sensors give, 0 for others; no accelerometer."""
    kept = {"torque": sensors.torque, "moment": sensors.moments, "bogie_moment": sensors.moments}
    names = (name.rstrip("_0123456789") for name in row_names(axles))
    flags = [float(kept.get(name, name in ("velocity", "load"))) for name in names]
    return torch.tensor(flags, dtype=torch.float64)


def lacking_sinkage(drives: MeasuredDrives, axles: int) -> MeasuredDrives:
    """Return drives whose sinkages are missing, with an unknown one in what is true."""
    measured, true = drives.tasks.measured.clone(), drives.tasks.true.clone()
    view = view_of(measured, axles)
    for missing in (view.sinkage, view.sinkage_sd):
        missing.fill_(math.nan)
    known = view_of(true, axles)
    known.sinkage_sd.copy_(UNKNOWN * known.sinkage)
    tasks = dataclasses.replace(drives.tasks, measured=measured, true=true)
    return dataclasses.replace(drives, tasks=tasks)


def lacking_contact_angle(drives: MeasuredDrives, model: PAlpaca) -> MeasuredDrives:
    """Return drives whose contact angles are those that the estimator supposes."""
    measured, true = drives.tasks.measured.clone(), drives.tasks.true.clone()
    view, known = view_of(measured, model.axles), view_of(true, model.axles)
    carried = nominal_of(model.physics).carried.sum(0)
    turned = view.bogie_angle.nan_to_num().unsqueeze(-1)
    view.contact_angle.copy_(turned * carried)
    for deviation in (view.contact_angle_sd, known.contact_angle_sd):
        deviation.fill_(SUPPOSED_SD)
    tasks = dataclasses.replace(drives.tasks, measured=measured, true=true)
    return dataclasses.replace(drives, tasks=tasks)


def judged(model: PAlpaca, drives: MeasuredDrives, sensors: Sensors) -> CellScore:
    """Return the score of the estimator with these sensors."""
    if not sensors.sinkage:
        drives = lacking_sinkage(drives, model.axles)
    if not sensors.contact_angle:
        drives = lacking_contact_angle(drives, model)
    rows, times = mask(sensors, model.axles), observation_times(TIMES_S)
    trace = run(model, drives.tasks.measured, times, drives.ends, rows)
    spread = CONSTANTS_SPREAD / math.sqrt(3.0)
    known = Known(rows.unsqueeze(0), drives.ends, drives.constants, spread)
    bound = cramer_rao_at(model, drives.tasks, times, known)[0]
    return score(judge(trace, drives, bound, model.hypotheses.prior_sd))


def _line(rover: str, sensors: Sensors, found: CellScore) -> list[str]:
    parts = (found.cohesion, found.tan_phi)
    holds = (each.coverage_95 for each in parts)
    return [
        rover,
        sensors.name,
        " / ".join(f"{100 * each.bound[-1]:.1f}" for each in parts),
        " / ".join(f"{100 * each.median_error[-1]:.1f}" for each in parts),
        " / ".join(f"{each.ratio_to_bound[-1]:.2f}" for each in parts),
        " / ".join(f"{100 * x.value:.0f} ({100 * x.low:.0f} to {100 * x.high:.0f})" for x in holds),
        " / ".join(f"{100 * each.identified:.0f}" for each in parts),
    ]


def main(args: list[str] | None = None) -> int:
    """Print the table."""
    parser = study_parser("studies.sensors", __doc__)
    parser.add_argument("--drives", type=int, default=DRIVES)
    options = parser.parse_args(args)
    lines = []
    for name in ROVERS:
        rover, soil = load_rover(name), load_soil(SOIL)
        model = physics_alone(rover, soil, exact=False)
        drives = draw_drives(
            rover, soil, "S1", options.drives, CONSTANTS_SPREAD, SEED, FROM_PRIOR,
            duration_s=TIMES_S[-1],
        )  # fmt: skip
        for sensors in SETS:
            lines.append(_line(name, sensors, judged(model, drives, sensors)))
            print(lines[-1], file=sys.stderr, flush=True)
    head = [
        "rover", "measured", "bound of c / tan phi [%]", "median error [%]", "error over bound",
        "95 % interval holds [%]", "variance at most a tenth [%]",
    ]  # fmt: skip
    print(table(head, lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
