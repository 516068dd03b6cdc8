# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The order of the D parameters k of a posterior."""

from typing import NamedTuple

from terrain_estimator.model.block import FIXED

FIRST_LEARNT = 2
"""Place of the first weight of the net, if there is one: behind c and tan phi."""
ROVER_PARAMETERS = FIXED - 1
"""Parameters of the rover, not of the ground: mass, centre of mass, acceleration bias, velocity."""


class ParameterLayout(NamedTuple):
    """First place of each group of parameters.

    k = [c (kPa), tan phi, net weights, soil constants, effects, rover's own]. The velocity is
    the last of the rover's own. All from ``first_effect`` on belong to the rover and stay when the
    ground changes.
    """

    first_constant: int
    first_effect: int
    first_fixed: int  # of the rover's own, whose columns do not depend on the observation
    size: int  # D
    constants: int  # M uncertain soil constants


def parameter_layout(net: int, constants: int, effects: int) -> ParameterLayout:
    """Return the layout with these numbers of net weights, soil constants and effects' values."""
    first_constant = FIRST_LEARNT + net
    first_effect = first_constant + constants
    first_fixed = first_effect + effects
    return ParameterLayout(
        first_constant, first_effect, first_fixed, first_fixed + ROVER_PARAMETERS, constants
    )
