# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of measured wheels: its references, one of its cases and its page."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.integrate import quad

from studies.measured.cases import CASES, HIT, MEASURED
from studies.measured.references import bekker, kernel, left_out_polynomial, polynomial
from studies.measured.study import WAYS, pull_share, study
from studies.measured.table import MeasuredRun, page
from studies.measured.worlds import WORLDS, world
from terrain_estimator.discovery.single_wheel.cells import ROWS, Row, cells_of

SINKAGE, PULL, LATERAL, TORQUE = range(len(ROWS))


def test_bekker_s_sinkage_carries_the_load_and_its_forces_are_in_balance() -> None:
    """The formula of a rigid wheel, by other steps than the study's."""
    bed = HIT.bed()
    soil, radius, width = bed.soil, bed.rover.wheel_radius, bed.rover.wheel_width
    row = Row("t", "1", 0.3, 80.0, 0.1, 0.01, 0.0, torque=0.0)
    found = bekker(cells_of([row]), soil, radius, width)[0]
    depth, stiffness = found[SINKAGE], soil.k_c / width + soil.k_phi
    # Bekker 1956: W = b k sqrt(z D) z^n (3 - n) / 3
    carried = width * stiffness * math.sqrt(2.0 * radius * depth) * depth**soil.n
    assert carried * (3.0 - soil.n) / 3.0 == pytest.approx(80.0)
    resistance = width * stiffness * depth ** (soil.n + 1.0) / (soil.n + 1.0)
    assert found[TORQUE] == pytest.approx(radius * (found[PULL] + resistance))
    length, slices = radius * math.acos(1.0 - depth / radius), 20000
    mobilised = sum(
        1.0 - math.exp(-0.3 * length * (k + 0.5) / slices / soil.shear_modulus)
        for k in range(slices)
    )
    strength = length * width * soil.cohesion + 80.0 * soil.tan_phi
    assert found[PULL] + resistance == pytest.approx(strength * mobilised / slices, rel=1e-6)
    assert math.isnan(found[LATERAL])


def test_the_kernel_carries_the_load_by_the_stresses_of_wong_and_reece() -> None:
    """Their integrals by SciPy, at the sinkage that the study finds."""
    bed = HIT.bed()
    soil, r, b, slip = bed.soil, bed.rover.wheel_radius, bed.rover.wheel_width, 0.3
    row = Row("t", "1", slip, 80.0, 0.1, 0.01, 0.0, torque=0.0)
    found = kernel(cells_of([row]), bed)[0]
    entry = math.acos(1.0 - found[SINKAGE] / r)
    largest = (soil.c1 + soil.c2 * slip) * entry
    stiffness = soil.k_c / b + soil.k_phi

    def normal(angle: float) -> float:
        mirrored = angle if angle > largest else entry - angle / largest * (entry - largest)
        return stiffness * (r * (math.cos(mirrored) - math.cos(entry))) ** soil.n

    def shear(angle: float) -> float:
        shift = r * (entry - angle - (1.0 - slip) * (math.sin(entry) - math.sin(angle)))
        mobilised = 1.0 - math.exp(-shift / soil.shear_modulus)
        return (soil.cohesion + normal(angle) * soil.tan_phi) * mobilised

    def total(stress: Callable[[float], float]) -> float:
        return r * b * quad(stress, 0.0, entry, points=[largest], epsabs=1e-9)[0]

    cos, sin = math.cos, math.sin
    assert total(lambda x: normal(x) * cos(x) + shear(x) * sin(x)) == pytest.approx(80.0, rel=1e-4)
    pull = total(lambda x: shear(x) * cos(x) - normal(x) * sin(x))
    assert found[PULL] == pytest.approx(pull, rel=1e-3)
    assert found[TORQUE] == pytest.approx(r * total(shear), rel=1e-3)


def test_the_share_of_the_pull_is_a_median_over_driving_slips() -> None:
    cells = cells_of(
        [Row("t", "1", slip, 80.0, 0.1, 0.01, pull) for slip, pull in ((0.0, 1.0), (0.2, 4.0))]
        + [Row("t", "2", slip, 80.0, 0.1, 0.01, 10.0) for slip in (0.4, 0.6)]
    )
    errors = np.zeros((4, len(ROWS)))
    errors[:, PULL] = (9.0, -2.0, 1.0, 3.0)
    assert pull_share(errors, cells) == pytest.approx(0.3)  # of 50, 10 and 30 %
    assert pull_share(None, cells) is None


def test_a_polynomial_of_enough_terms_meets_settings_that_it_was_not_fitted_to() -> None:
    slips = (0.0, 0.1, 0.2, 0.3, 0.5)
    rows = [Row("t", "1", slip, 80.0, 0.1, 0.01 + 0.1 * slip**2, 5.0 - slip) for slip in slips]
    cells = cells_of(rows)
    known = [SINKAGE, PULL]
    exact = left_out_polynomial(cells, 3)
    assert exact[:, known] == pytest.approx(cells.measured[:, known].numpy(), abs=1e-9)
    line = left_out_polynomial(cells, 2)
    assert abs(line[:, SINKAGE] - cells.measured[:, SINKAGE].numpy()).max() > 1e-3
    few = polynomial(cells.part([0, 1]), cells.part([4]), 3)
    assert few[0, PULL] == pytest.approx(5.0 - 0.05), "two values have one term, their mean"


def test_the_lateral_force_of_a_polynomial_has_the_sign_of_the_slip_angle() -> None:
    rows = [
        Row("t", "1", slip, 80.0, 0.1, 0.01, 5.0, angle, 4.0 * slip * math.copysign(1.0, angle))
        for slip in (0.1, 0.3, 0.6)
        for angle in (-0.3, 0.3)
    ]
    cells = cells_of(rows)
    found = polynomial(cells, cells, 2)[:, LATERAL]
    assert found == pytest.approx(cells.measured[:, LATERAL].numpy(), abs=1e-9)


def test_every_table_of_the_repository_is_a_case() -> None:
    used = {f"{case.laboratory.name}_{case.table}.csv" for case in CASES}
    assert used == {path.name for path in MEASURED.glob("*.csv")}
    assert all(case.references <= {row.table for row in case.rows} for case in CASES)


def test_a_case_and_a_world_stand_on_the_page() -> None:
    torch.set_num_threads(1)
    case = CASES[2]
    found = study(case, 0)
    assert found.settings == 6
    assert set(found.rows) == set(WAYS)
    assert set(found.rows["bekker"]) == {"sinkage", "drawbar_pull"}
    assert found.fits.measured is None
    judged = world(WORLDS[0], 1, 0)
    assert judged.cohesion_covered in (0, 1)
    assert 0.0 < judged.cohesion_width_pa < 1e4
    text = page(MeasuredRun("Measured.", 0, [found], [], [judged]))
    assert f"| {case.title} | 6 |" in text
    assert f"| {judged.name} | 1 |" in text
