# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Advice on separating confusable effects: the best next drive, and effects beyond drives."""

from collections.abc import Sequence

from terrain_estimator.discovery.next_drive.next_drive import NextDrive

BESIDES = {
    "slope_bias": (
        "stand still on level ground in two headings: only a tilted sensor reads two pitches"
    ),
    "drive_drag": "lift the wheels and turn them at two rates: drag stays without soil",
    "coulomb_drag": (
        "lift the wheels and turn them in both directions: dry friction stays without soil"
    ),
    "payload": "weigh the rover",
    "multipass": "drive off the own track (crab or turn), then on it: what the rut does disappears",
    "odometry_scale": "roll a measured distance on a hard floor: a wrong radius stays there",
    "sinkage_bias": "stand on a hard floor, where sinkage has to read zero",
    "exit_angle": "measure the depth of the rut behind a wheel against the wheel's sinkage",
}
"""Advice by effect beyond the simulated drives: standing still, lifted wheels, a rule."""


def advise(names: Sequence[str], drives: Sequence[NextDrive]) -> str:
    """Return advice on separating these effects; empty for fewer than two.

    ``drives`` are the best first.
    """
    if len(set(names)) <= 1:
        return ""
    advice = [
        f"For {each} alone: {BESIDES[each]}" for each in sorted(set(names)) if each in BESIDES
    ]
    if drives:
        best, (true, other) = drives[0], drives[0].pair
        told = (
            f"Drive {best.seconds:.0f} s {best.words}: {best.nats:.0f} nat more are expected, if it"
            f" is {true}, against {other}"
        )
        advice.insert(0, told)
    return ". ".join(advice)
