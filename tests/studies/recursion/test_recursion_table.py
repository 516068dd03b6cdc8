# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of ``make recursion``, from records with known errors."""

import numpy as np
import pytest

from studies.recursion.study import ROW_SETS, SHIPPED, Record, methods
from studies.recursion.table import cells, page

DRIVES = 40


def made_up() -> Record:
    """Return a record whose errors of c are one deviation, but three in 10 drives that ship."""
    truth = np.tile([2000.0, 0.5], (DRIVES, 1))
    record = {"truth": truth}
    for rows in ROW_SETS:
        record[f"{rows}|bound|least"] = np.tile([100.0, 0.01], (DRIVES, 1, 1))
        for method in methods():
            error = np.tile([100.0, 0.01], (DRIVES, 1, 1))
            if method == SHIPPED:
                error[:10, :, 0] = 300.0
            record[f"{rows}|{method}|mean"] = truth[:, None] + error
            covariance = np.diag([100.0**2, 0.01**2])
            record[f"{rows}|{method}|covariance"] = np.tile(covariance, (DRIVES, 1, 1, 1))
            record[f"{rows}|{method}|clamped"] = np.full((DRIVES, 1), 0.25)
    return record


def test_shares_ratios_and_pairs_are_those_of_the_record() -> None:
    """Two records are pooled."""
    shipped, other = cells("mars_rover", [made_up(), made_up()], (40.0,))[:2]
    assert (shipped.drives, shipped.method) == (2 * DRIVES, SHIPPED)
    assert shipped.cohesion.inside_95.value == 0.75
    assert (other.cohesion.alone, other.cohesion.not_alone) == (20, 0)
    assert other.cohesion.median_error == pytest.approx(0.05)
    assert other.cohesion.of_bound == pytest.approx(1.0 / 0.67449, rel=1e-4)
    assert other.tan_phi.mean_z == pytest.approx(1.0)


def test_the_page_has_a_line_for_every_method_and_row_set() -> None:
    """Each with its share in 95 %."""
    written = page(cells("mars_rover", [made_up()], (40.0,)), "Measured.", 7)
    assert written.count("\n| ") == (len(ROW_SETS) + 1) * (len(methods()) + 2)
    assert "| 75.0 (" in written
    assert "seed 7" in written
    assert f"## mars_rover, {ROW_SETS[0]} after 40 s" in written
