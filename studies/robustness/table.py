# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures and the page of ``make robustness``."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from studies.accuracy.scores import share_of
from studies.limited import Limited
from studies.robustness.drives import Record
from studies.robustness.worlds import BATCH, DRIFT_S, SECONDS, VARIATION_M, World
from studies.tables import licence, table
from terrain_estimator.messaging.messages import Status

VISIBLE = 20.0
"""[1] Excess of ten seconds from which on a hidden effect can be seen in time."""
FEWEST = 100
"""[1] Drives below which a world is not judged."""
BAR = 0.95


@dataclass(frozen=True, slots=True)
class WorldScore:
    """What was published in one world."""

    kind: str
    name: str
    drives: int
    identified: float  # share of drives that end so
    disagrees: float
    sound: Limited  # ends that are not IDENTIFIED, or hold both truths
    wrong_at: float  # share of all answers that are IDENTIFIED and do not
    shift: tuple[float, float]  # median z of c and tan phi of drives that end IDENTIFIED
    excess: float  # median
    visible: int  # drives with an excess of at least VISIBLE
    sound_visible: Limited | None


def line(world: World, record: Record) -> WorldScore:
    """Return the figures of a world."""
    identified = record["status"] == Status.IDENTIFIED
    sound = ~identified | (record["inside"] > 0.0).all(1)
    visible = record["excess"] >= VISIBLE
    z = (record["mean"] - record["truth"])[identified] / record["deviation"][identified]
    shift = np.median(z, 0) if len(z) else np.full(2, np.nan)
    return WorldScore(
        world.kind,
        world.name,
        len(sound),
        float(identified.mean()),
        float((record["status"] == Status.DISAGREES).mean()),
        _share(sound),
        float(record["wrong"].mean()),
        (float(shift[0]), float(shift[1])),
        float(np.nanmedian(record["excess"])),
        int(visible.sum()),
        _share(sound[visible]) if visible.any() else None,
    )


def _share(flags: "np.ndarray[tuple[int], np.dtype[np.bool_]]") -> Limited:
    return share_of(torch.from_numpy(np.ascontiguousarray(flags)))


INTRODUCTION = """# Where the world is not the model's

{measured}

What does the estimator publish where something is hidden from it? Each line hides one thing. All
drives are simulated: Mars-like rover, {seconds:g} s over hills (S1), seed {seed}. Unless the line
says otherwise, the soil is loose sand with each constant up to 5 % wrong. The estimator is the
node's, with default parameters, the averaging of fast readings and the model that ships.

- **Other rates**: so many readings a second, each with the usual noise.
- **Other rovers**: mass, wheel radius and wheel width up to 30 % away from a preset. Here the file
  says so and the model is the physics alone for that rover, one for every {batch} drives.
- **Varying ground**: c, tan phi and the stiffness deviate by so much along the way, drawn anew
  every {varied:g} m, independently, linear between. The truth is their mean. "Model for 2 %" is
  that made with `train --ground-variation 0.02`, as `mars_rover_on_varying_ground` is.
- **Hidden effects** come from the generators of [hidden.md](hidden.md), at the size that matters.
  They share no law with the library. "Outside the library" are effects that it has no name for.
- **Misstated noise**: the sensors' noise is not what the messages state.
- **Drifting odometry**: the velocity has an error of 2 or 5 % of itself, correlated over
  {drift:g} s, that nothing states. "And slip": the slip is computed from such a velocity.
- **Unknown soil**: all six constants are drawn; the model knows three soils.
- **Misstated rover**: mass, wheel radius and wheel width of the rover that drives are up to 30 %
  away from its file.
- **All together**: every five drives have an effect, noise and a rover of their own, each drive a
  soil of its own.

Figures in %:

- **Sound**: drives that end with a status other than IDENTIFIED, or with both truths in their 95 %
  intervals. Brackets are 99 % limits. The bar is 95 %.
- **Wrong answers**: of all answers, those IDENTIFIED with a truth outside its interval.
- **Shift**: median error of c and tan phi in published deviations, of drives that end IDENTIFIED.
  Where the sign of an effect is drawn (slope_bias, odometry_scale, sinkage_bias, rate_dependence),
  errors of both signs cancel in it.
- **Excess**: median over drives. By how much the squared distances of ten seconds exceed their
  degrees of freedom. From {visible:g} on an effect can be seen within a drive. What an effect does
  within the reach of c and tan phi leaves no excess: no test can see it.

"""


def page(lines: Sequence[WorldScore], measured: str, seed: int) -> str:
    """Return the whole page."""
    head = (
        "hidden",
        "drives",
        "IDENTIFIED",
        "DISAGREES",
        "sound",
        "wrong answers",
        "shift of c, tan phi",
        "excess",
        "with an excess of 20",
        "sound, of these",
        "holds",
    )
    text = INTRODUCTION.format(
        measured=measured,
        seconds=SECONDS,
        seed=seed,
        visible=VISIBLE,
        batch=BATCH,
        drift=DRIFT_S,
        varied=VARIATION_M,
    )
    for kind in dict.fromkeys(each.kind for each in lines):
        rows = [_cells(each) for each in lines if each.kind == kind]
        text += f"## {kind.capitalize()}\n\n{table(head, rows)}\n"
    return licence("robustness") + text.rstrip() + "\n"


def _cells(each: WorldScore) -> list[str]:
    shift = ", ".join(f"{value:+.1f}" for value in each.shift)
    return [
        each.name,
        str(each.drives),
        _percent(each.identified),
        _percent(each.disagrees),
        _limited(each.sound),
        f"{100.0 * each.wrong_at:.1f}",
        shift if each.identified else "",
        f"{each.excess:.0f}",
        str(each.visible),
        _limited(each.sound_visible) if each.sound_visible else "",
        _holds(each),
    ]


def _holds(each: WorldScore) -> str:
    """Return whether the bar holds for the drives whose effect can be seen."""
    if each.drives < FEWEST:
        return "not judged"
    judged = each.sound if each.excess < 0.0 or not each.sound_visible else each.sound_visible
    return "yes" if judged.high >= BAR else "**no**"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f}"


def _limited(share: Limited) -> str:
    return f"{_percent(share.value)} ({_percent(share.low)} to {_percent(share.high)})"
