# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every unit of a mapping has the size that scipy's table of constants gives it."""

import pytest
from scipy import constants

from terrain_estimator.importing.units import UNITS, factor

TURN = 2.0 * constants.pi
EXPECTED = {
    ("time", "s"): 1.0,
    ("time", "ms"): constants.milli,
    ("time", "us"): constants.micro,
    ("time", "ns"): constants.nano,
    ("ratio", "1"): 1.0,
    ("ratio", "%"): constants.centi,
    ("length", "m"): 1.0,
    ("length", "cm"): constants.centi,
    ("length", "mm"): constants.milli,
    ("angle", "rad"): 1.0,
    ("angle", "deg"): constants.degree,
    ("wheel rate", "rad/s"): 1.0,
    ("wheel rate", "deg/s"): constants.degree,
    ("wheel rate", "rpm"): TURN / constants.minute,
    ("wheel rate", "1/s"): TURN,
    ("yaw rate", "rad/s"): 1.0,
    ("yaw rate", "deg/s"): constants.degree,
    ("torque", "N m"): 1.0,
    ("torque", "N cm"): constants.centi,
    ("torque", "N mm"): constants.milli,
    ("velocity", "m/s"): 1.0,
    ("velocity", "cm/s"): constants.centi,
    ("velocity", "mm/s"): constants.milli,
    ("velocity", "km/h"): constants.kmh,
    ("acceleration", "m/s^2"): 1.0,
    ("acceleration", "mm/s^2"): constants.milli,
    ("acceleration", "g"): constants.g,
}


def test_no_unit_is_without_an_independent_size() -> None:
    assert {(quantity, unit) for quantity, units in UNITS.items() for unit in units} == set(
        EXPECTED
    )


@pytest.mark.parametrize(("quantity", "unit"), EXPECTED)
def test_a_unit_has_its_size_in_si(quantity: str, unit: str) -> None:
    assert factor(quantity, unit) == pytest.approx(EXPECTED[quantity, unit], rel=1e-14)


def test_an_unknown_unit_is_refused_with_those_that_are_known() -> None:
    with pytest.raises(ValueError, match=r"unknown unit 'mph' of velocity: .* m/s, .* km/h"):
        factor("velocity", "mph")
