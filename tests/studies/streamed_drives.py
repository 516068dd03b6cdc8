# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Results of drives with known errors, for the figures of the studies of streamed drives."""

import numpy as np
from numpy.typing import NDArray

from studies.stream.drives import Streamed

SD = np.array([100.0, 0.01])
"""Published deviation of c [Pa] and tan phi, that of the bound, too."""


def streamed(errors: NDArray[np.float64]) -> Streamed:
    """Return identified drives off by ``errors`` [N, K] published deviations, c 2 kPa, tan phi 0.5.

    None has an observation.
    """
    count, times = errors.shape
    truth, sd = np.tile([2000.0, 0.5], (count, 1)), np.tile(SD, (count, times, 1))
    off = np.repeat(errors[..., np.newaxis], 2, -1)
    nothing = np.zeros((count, 0))
    return Streamed(
        truth=truth,
        mean=truth[:, np.newaxis] + off * sd,
        deviation=sd,
        inside_95=(np.abs(off) < 1.96).astype(float),
        identified=np.ones((count, times, 2)),
        published=np.ones(count),
        least=sd.copy(),
        innovation=nothing,
        variance=nothing,
        soil_probability=nothing,
        soil_right=nothing,
        refused=np.zeros(count),
        observations=np.ones(count),
    )
