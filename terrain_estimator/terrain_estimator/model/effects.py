# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The named effects that a model can estimate beside the ground."""

from terramechanics.effects import EFFECTS
from terramechanics.effects.grousers import BlendedGrousers
from terramechanics.effects.law import Law
from terramechanics.effects.soil import BlendedBulldozing
from terramechanics.vehicle.wheel_places import WheelPlaces

ASIDE = "lateral_bulldozing"
"""Effect that models by wheel alone can have."""
NOT_ONLINE = {
    "latency": (
        "it needs what was measured before and after; subtract the latency from the stamps of slip"
        " and sinkage instead"
    ),
    "failed_wheel": (
        "the true slip of its wheels depends on c and tan phi; leave the axle's slip out (NaN)"
        " instead"
    ),
    "contact_law_scm": (
        "at one instant its ruts and the slip of wheels that hardly slip are too uncertain; train a"
        " model on a soil file with law: scm instead"
    ),
    ASIDE: "it acts sideways, which a planar rover does not show",
}
"""Effects that cannot be estimated online: the reason, and what to do instead."""

NOT_ONLINE_BY_WHEEL = {
    "multipass": "which wheels rolled over the same ground before is not known in a turn",
    "payload": "its models have one mass: give the loaded mass in the rover file instead",
}
"""Effects that models by wheel cannot have beside NOT_ONLINE, and why."""
LAWS_OF_MODELS: dict[str, type[Law]] = {"bulldozing": BlendedBulldozing}
"""Laws of models in place of the registry's, with as many values.

The deviations of further values are shares of the size. A force that goes with c and tan(phi) ties
its size to them.
"""
STEERED_LAWS: dict[str, type[Law]] = LAWS_OF_MODELS | {"grousers": BlendedGrousers}
"""The same of models by wheel of steered rovers.

Their wheels slip by so little that the two values of the registry's grousers do not show apart, and
a thrust that grows with the load ties its size to c and tan(phi). So here the size is the thrust
with what load and cohesion give.
"""
LAWS = {
    name: effect.law for name, effect in EFFECTS.items() if name not in NOT_ONLINE
} | LAWS_OF_MODELS
"""Laws of the effects that a model by axle can have, by the registry's names."""


def not_estimated(*, by_wheel: bool) -> dict[str, str]:
    """Return the effects that models by axle or by wheel cannot estimate, and why."""
    if not by_wheel:
        return NOT_ONLINE
    return {name: why for name, why in NOT_ONLINE.items() if name != ASIDE} | NOT_ONLINE_BY_WHEEL


def laws_apart(places: WheelPlaces | None) -> dict[str, type[Law]]:
    """Return the laws that are not the registry's in a model of wheels at ``places``.

    ``places`` is None of a model by axle.
    """
    return STEERED_LAWS if places is not None and places.steered else LAWS_OF_MODELS
