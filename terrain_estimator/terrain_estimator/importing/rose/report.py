# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a user should know of an imported trial, and the signals that its bag has."""

from collections.abc import Iterator

import numpy as np

from terrain_estimator.importing.mapping import (
    BodySignal,
    Mapping,
    SignalNoise,
    Time,
    WheelColumns,
    WheelSignal,
)
from terrain_estimator.importing.rose.motion import STEP
from terrain_estimator.importing.rose.samples import Found
from terrain_estimator.importing.rose.schema import (
    CURRENTS,
    ORIENTATION,
    POSITION,
    RATES,
    TIME,
    RoseOptions,
    wheel_order,
)
from terramechanics.vehicle.rover import Rover

ABSENT = "not in the data: {names}; wheel_sinkage holds NaN for each sinkage"
REFUSED = (
    ", and without {needed} the estimator refuses every observation (NOT_FINITE) and replay gives"
    " NO ESTIMATE"
)


def report(found: Found, options: RoseOptions) -> Iterator[str]:
    """Yield sentences about noise, gaps, turns, and what the bag lacks."""
    sds = [sample.velocity.deviation for sample in found.samples]
    source = "--position-sd" if options.position_sd else "by what the lines miss"
    yield (
        f"velocity: lines through the poses of {found.window:.3g} s, every second pose for slip"
        f" and the others for odom; deviation {1e3 * float(np.median(sds)):.3g} mm/s in the median,"
        f" from {1e3 * found.position_sd:.3g} mm of a position ({source})"
    )
    yield from found.notes
    if found.without_pose_s:
        yield f"{found.without_pose_s:.1f} s lack poses and are left out"
    if found.held_s:
        yield (
            f"{found.held_s:.1f} s repeat one pose while wheels turn, as where tracking is lost,"
            " and are left out"
        )
    turned = "left out" if options.straight_only else "kept (--straight-only leaves them out)"
    beyond = "a model by axle refuses turns beyond its turn_limit, one by wheel uses them"
    yield (
        f"the rover turns for {found.turning_s:.1f} of {STEP * len(found.motions):.1f} s (yaw rate"
        f" above {options.turn_rate:g} rad/s): {beyond}"
        + (f", they are {turned}" if found.turning_s else "")
    )
    given = {
        "contact_angle": options.contact_angle_sd > 0.0,
        "torque": options.torque_gain is not None,
        "acceleration": bool(options.acceleration_axis),
    }
    absent = ["sinkage", *(name for name, there in given.items() if not there)]
    ways = {"contact_angle": "--contact-angle-sd", "torque": "--torque-gain"}
    needed = " and ".join(way for name, way in ways.items() if name in absent)
    refused = REFUSED.format(needed=needed) if needed else ""
    yield ABSENT.format(names=", ".join(absent)) + refused
    if options.torque_gain is not None:
        yield (
            "joint_states has no field for noise: give that of the torque to replay and"
            f" find_missing_effect: -p torque_noise.relative:={options.torque_sd:g}"
        )


def mapping_of(rover: Rover, options: RoseOptions) -> Mapping:
    """Return the mapping by which the samples are written; each carries its own deviation."""
    some = SignalNoise(absolute=1.0)
    torque = options.torque_gain is not None
    wheels = tuple(
        WheelColumns(
            name,
            slip=RATES[at],
            wheel_rate=RATES[at],
            torque=CURRENTS[at] if torque else "",
        )
        for name, at in zip(rover.wheel_names, wheel_order(rover), strict=True)
    )
    body = {
        "velocity": BodySignal(POSITION[0], "m/s", some),
        "pitch": BodySignal(ORIENTATION[0], "rad", some, positive="nose_up"),
        "roll": BodySignal(ORIENTATION[0], "rad", some),
        "yaw_rate": BodySignal(ORIENTATION[0], "rad/s", some),
    }
    if options.acceleration_axis:
        body["acceleration"] = BodySignal("lin_acc", "m/s^2", some)
    sections = {"slip": WheelSignal("1", some), "wheel_rate": WheelSignal("rad/s")}
    if torque:
        sections["torque"] = WheelSignal("N m")
    return Mapping(time=Time(TIME), wheels=wheels, **sections, **body)  # type: ignore[arg-type]
