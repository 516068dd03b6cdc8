# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What stands beside the fitted law: formulas without a fit, and polynomials without physics."""

import numpy as np

from terrain_estimator.discovery.hypotheses.library import NOTHING
from terrain_estimator.discovery.single_wheel.cells import ROWS, Cells, Rig
from terrain_estimator.discovery.single_wheel.fit import STRENGTH, WheelModel
from terrain_estimator.model.rows import PA_PER_UNIT
from terrain_estimator.observation import Floats
from terramechanics.terrain.soil import Soil


def bekker(cells: Cells, soil: Soil, radius: float, width: float) -> Floats:
    """Return the rows [B, R] by Bekker's and Janosi's formulas, without any fit.

    Static sinkage and compaction resistance of a rigid wheel (Bekker 1956, Wong 2001 eqs. 2.61 and
    2.63), Janosi and Hanamoto's thrust (1961) below an evenly loaded contact of length
    r acos(1 - z / r). NaN at a slip angle, for which the formulas have no row::

        z = (3 W / (b k sqrt(2 r) (3 - n)))^(2 / (2 n + 1)),   k = k_c / b + k_phi
        H = (A c + W tan phi) (1 - K / (i l) (1 - exp(-i l / K)))
        T = H - b k z^(n + 1) / (n + 1),   M = r H
    """
    load, slip = cells.load.numpy(), cells.slip.numpy()
    stiffness = soil.k_c / width + soil.k_phi
    power = 2.0 / (2.0 * soil.n + 1.0)
    carried = width * stiffness * np.sqrt(2.0 * radius) * (3.0 - soil.n)
    depth = (3.0 * load / carried) ** power
    length = radius * np.arccos(1.0 - depth / radius)
    sheared = np.maximum(np.abs(slip) * length / soil.shear_modulus, 1e-9)
    mobilised = np.sign(slip) * (1.0 + np.expm1(-sheared) / sheared)
    thrust = (length * width * soil.cohesion + load * soil.tan_phi) * mobilised
    resistance = width * stiffness * depth ** (soil.n + 1.0) / (soil.n + 1.0)
    rows = np.full((len(slip), len(ROWS)), np.nan)
    straight = cells.slip_angle.numpy() == 0.0
    for name, values in (
        ("sinkage", depth),
        ("drawbar_pull", thrust - resistance),
        ("torque", radius * thrust),
    ):
        rows[straight, ROWS.index(name)] = values[straight]
    return rows


def kernel(cells: Cells, bed: Rig) -> Floats:
    """Return the rows [B, R] by the Bekker-Wong kernel, without any fit.

    Wong and Reece's stresses (1967) under a rigid wheel with Bekker's pressure and Janosi's shear
    at each place of the contact, which carry the load: the contact law itself with c, tan phi and
    all constants as measured, sensors without errors, and no effect.
    """
    model = WheelModel(bed, NOTHING, NOTHING)
    values = model.start()
    measured = (bed.soil.cohesion / PA_PER_UNIT, bed.soil.tan_phi)
    values[:2] = [(x - mean) / sd for x, (mean, sd) in zip(measured, STRENGTH, strict=True)]
    return model.of(cells, values)


def polynomial(fitted: Cells, wanted: Cells, terms: int) -> Floats:
    """Return the rows [B, R] of ``wanted`` by a polynomial for each row, fitted to other cells.

    In slip, and in the size of the slip angle where there is one; ``terms`` at most, and fewer than
    there are values. The lateral force has the sign of the angle.
    """
    rows = np.full((len(wanted.slip), len(ROWS)), np.nan)
    turned = bool(fitted.slip_angle.any())
    for k, name in enumerate(ROWS):
        known = fitted.seen[:, k].numpy()
        count = min(terms, int(known.sum()) - 1)
        if count < 1:
            continue
        signs = [
            np.sign(each.slip_angle.numpy()) if name == "lateral_force" else np.ones(len(each.slip))
            for each in (fitted, wanted)
        ]
        table = _terms(fitted, turned=turned)[:, :count]
        values = (fitted.measured[:, k].numpy() * signs[0])[known]
        weights, *_ = np.linalg.lstsq(table[known], values, rcond=None)
        rows[:, k] = _terms(wanted, turned=turned)[:, :count] @ weights * signs[1]
    return rows


def _terms(cells: Cells, *, turned: bool) -> Floats:
    """Return the terms, the simplest first."""
    slip, angle = cells.slip.numpy(), np.abs(cells.slip_angle.numpy())
    one = np.ones_like(slip)
    straight = [one, slip, slip**2, slip**3, slip**4]
    sideways = [one, slip, angle, slip**2, angle**2, slip * angle, slip**3]
    return np.stack(sideways if turned else straight, 1)


def left_out_polynomial(cells: Cells, terms: int) -> Floats:
    """Return the rows [F, R] of each setting in which effects may act, fitted without it.

    To settings of its own table.
    """
    own = [k for k in range(len(cells.slip)) if bool(cells.acts[k])]
    found = [
        polynomial(cells.part([k for k in own if k != out]), cells.part([out]), terms)
        for out in own
    ]
    return np.concatenate(found)
