# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The named effects that a model can estimate beside the ground."""

from terramechanics.effects import EFFECTS

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
    "lateral_bulldozing": "it acts sideways, which a planar rover does not show",
}
"""Effects that cannot be estimated online: the reason, and what to do instead."""

LAWS = {name: effect.law for name, effect in EFFECTS.items() if name not in NOT_ONLINE}
"""Laws of the effects that a model can have, by the registry's names."""
