# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Influence of hidden effects on the estimator: `python -m tests.hidden.matters [NAME ...]`.

The same drives, noise and seed with and without the effect go through the recursion of physics
alone, soil constants uncertain, all rows. An effect matters at the size at which in half of the
one-minute drives it shifts c or tan(phi) by more than SHIFT of the deviations that five such drives
would give together, or at which the mean misfit of a block is FACTOR times what it was: it then
ruins the estimate of the ground or the prediction of motion.
"""

import argparse
import dataclasses
import math
import sys
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from studies.batched import Trace, run
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.model.packing import pack_measurement
from terramechanics.presets import load_soil
from terramechanics.simulation.sample import Measurement
from tests.hidden.cases import DRIVES, EACH, Plan, Simulated, drive_ends, simulate_cases
from tests.hidden.generators import GENERATORS

SHIFT = 5.0
FACTOR = 2.0
SEED = 7
PER_AXLE = ("slip", "sinkage", "contact_angle", "wheel_rate", "torque")


@dataclass(frozen=True, slots=True)
class Damage:
    """Influence of an effect on estimates, over all drives."""

    # median over drives of the larger shift of c and tan(phi), in deviations of five drives
    shift: float
    cohesion: float  # its part in c
    friction: float  # its part in tan(phi)
    misfit: float  # mean misfit of a block over that without the effect
    stuck: float  # share of the drives that get stuck

    @property
    def matters(self) -> bool:
        """True where the effect matters."""
        return self.shift > SHIFT or self.misfit > FACTOR


def axle_means(measured: Measurement, axles: int) -> Measurement:
    """Return the measurement of every axle: the mean of its two wheels."""
    values = {}
    for name in PER_AXLE:
        pairs = getattr(measured, name)
        count = pairs.shape[-1] // axles
        values[name] = pairs.reshape(*pairs.shape[:-1], axles, count).mean(-1)
        if hasattr(measured, f"{name}_sd"):
            spread = (
                torch.as_tensor(getattr(measured, f"{name}_sd"))
                .expand_as(pairs)
                .reshape(*pairs.shape[:-1], axles, count)
            )
            values[f"{name}_sd"] = spread.square().mean(-1).sqrt() / math.sqrt(count)
    return dataclasses.replace(measured, **values)


def estimate(simulated: Simulated) -> dict[str, Trace]:
    """Return the estimates after each drive, by soil: the drives of one soil are one batch."""
    rover = simulated.drive.rover
    packed = pack_measurement(axle_means(simulated.measured, rover.axles))
    ends = drive_ends(simulated.drive)
    traces = {}
    for soil in sorted(set(simulated.soils)):
        here = torch.tensor([name == soil for name in simulated.soils]).repeat_interleave(EACH)
        model = physics_alone(rover, load_soil(soil), exact=False)
        traces[soil] = run(model, packed[here], torch.tensor([packed.shape[1] - 1]), ends[here])
    return traces


def damage(name: str, size: float, cases: int, seed: int = SEED) -> Damage:
    """Return the influence of the effect at ``size`` times the one that matters."""
    without = _nominal(cases, seed)
    hidden = simulate_cases(Plan(((name, size),)), cases, seed)
    with_it = estimate(hidden)
    shifts = torch.cat([_shift(without[soil], with_it[soil]) for soil in without])
    misfits = [
        torch.cat([_misfit(trace) for trace in traces.values()]).nanmean()
        for traces in (without, with_it)
    ]
    stuck = float(hidden.drive.sample.stuck[:, -1].double().mean())
    medians = shifts.nanmedian(0).values
    larger = float(shifts.amax(1).nanmedian())
    return Damage(
        larger, float(medians[0]), float(medians[1]), float(misfits[1] / misfits[0]), stuck
    )


@cache
def _nominal(cases: int, seed: int) -> dict[str, Trace]:
    return estimate(simulate_cases(Plan(), cases, seed))


def _shift(without: Trace, with_it: Trace) -> Tensor:
    """Return the shifts of c and tan(phi) [drives, 2], in deviations of five drives together."""
    spread = without.covariance[:, -1].diagonal(dim1=-2, dim2=-1).sqrt()
    return (with_it.mean[:, -1] - without.mean[:, -1]).abs() / spread * math.sqrt(DRIVES)


def _misfit(trace: Trace) -> Tensor:
    """Return the misfit of each block over its degrees of freedom."""
    return (trace.misfit / trace.degrees).flatten()


def main() -> None:
    """Print a line for every effect."""
    torch.set_num_threads(1)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", default=list(GENERATORS), help="hidden effects")
    parser.add_argument("--cases", type=int, default=8)
    parser.add_argument("--shares", type=float, nargs="+", default=[1.0])
    options = parser.parse_args()
    columns = ("effect", "share", "size", "c", "tan phi", "larger", "misfit", "stuck", "matters")
    say = sys.stdout.write
    say(
        "shifts of c and tan phi in deviations of five drives\n"
        + "".join(f"{column:>16}" for column in columns)
        + "\n"
    )
    for name in options.names:
        for share in options.shares:
            found = damage(name, share, options.cases)
            numbers = (
                share,
                share * GENERATORS[name].matters,
                found.cohesion,
                found.friction,
                found.shift,
                found.misfit,
                found.stuck,
            )
            say(
                f"{name:>16}"
                + "".join(f"{number:16.3g}" for number in numbers)
                + f"{found.matters!s:>16}\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
