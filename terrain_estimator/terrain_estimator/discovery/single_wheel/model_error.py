# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the contact law misses, as a Gaussian process over the settings of a table.

Of one row it has the covariance s^2 exp(-distance). The distance of two settings is that in slip
over SLIP, in the logarithm of the load over LOAD, in slip angle over ANGLE, and TABLE more where
the effects that are looked for act in one of them only.
"""

import numpy as np

from terrain_estimator.discovery.single_wheel.cells import Cells
from terrain_estimator.observation import Floats

SLIP, LOAD, ANGLE, TABLE = 0.3, 0.5, 0.5, 1.0
"""[1], [1], [rad], [1] Lengths of the model error; chosen, not fitted."""


def correlation(cells: Cells) -> Floats:
    """Return the correlation [B, B] of the model error between settings."""
    scaled = (
        cells.slip.numpy() / SLIP,
        np.log(cells.load.numpy()) / LOAD,
        cells.slip_angle.numpy() / ANGLE,
        cells.acts.numpy() * TABLE,
    )
    return np.exp(-sum(np.abs(each[:, None] - each) for each in scaled))
