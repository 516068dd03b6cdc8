# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How long a drive without torques and moments is remembered.

Rows are linear about the soil constants of their time, and are not linearised anew. Torques tell
the constants in a minute; velocity and load alone move them for an hour. After MEMORY_S of driving
a second without torques and moments therefore takes weight from all that is known, what these told
before included: intervals are those of so long a drive, however long the rover drives on
(docs/long_drives.md).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rover_parameters.records import ConfigError
from terrain_estimator.model.runtime import Runtime, RuntimeState
from terrain_estimator.observation import Floats

MEMORY_S = 400.0
"""[s] Time without torques and moments in which rows of before lose all but 1/e of their weight.

Intervals of drives of that length hold.
"""


class Memory(NamedTuple):
    """The prior of each kind of hypotheses, to which the posterior goes back, as one Gaussian."""

    mean: Floats  # [K, D]
    precision: Floats  # [K, D, D]
    telling: NDArray[np.bool_]  # [R] rows that tell the soil constants

    @classmethod
    def of(cls, runtime: Runtime, start: RuntimeState, rows: Sequence[str]) -> "Memory":
        """Take a state before the first observation, and the names of the model's R rows.

        Raises:
            ConfigError: a deviation of the prior is too small or too large for its inverse.
        """
        arrays = runtime.arrays(start)
        kinds = range(int(arrays["kind"].max()) + 1)
        members = [arrays["kind"] == kind for kind in kinds]
        told = [row.startswith("torque") or "moment" in row for row in rows]
        try:
            moments = [
                _moments(arrays["weight"][own], arrays["mean"][own], arrays["precision"][own][0])
                for own in members
            ]
            means, covariances = map(np.stack, zip(*moments, strict=True))
            precision = np.linalg.inv(covariances)
        except np.linalg.LinAlgError:
            means = precision = np.array(np.nan)
        if not np.isfinite(precision).all():
            raise ConfigError(
                "parameters prior.*: a deviation is too small or too large to compute with: give"
                " deviations of soils, in Pa and 1"
            )
        return cls(means, precision, np.array(told))

    def needs(self, there: NDArray[np.bool_], driven_s: float) -> bool:
        """Return whether what is known loses weight after a second that had the rows ``there`` [R].

        ``driven_s`` [s] is the time of driving since the prior.
        """
        return driven_s > MEMORY_S and not bool((there & self.telling).any())

    def faded(self, runtime: Runtime, state: RuntimeState, passed_s: float) -> RuntimeState:
        """Return the state after all rows in it lost weight for ``passed_s`` [s].

        Every hypothesis becomes the geometric mean of itself and of its prior, with weights L and
        1 - L, L = exp(-passed_s / MEMORY_S): L of the information of its rows is left (Kulhavy and
        Zarrop 1993, On a general concept of forgetting, Int. J. Control 58). The evidence of each,
        and with it that of the soils, stays.
        """
        left = math.exp(-passed_s / MEMORY_S)
        arrays = runtime.arrays(state)
        prior = arrays["kind"]
        old, own = left * arrays["precision"], (1.0 - left) * self.precision[prior]
        known = old @ arrays["mean"][:, :, None] + own @ self.mean[prior][:, :, None]
        precision = old + own
        try:
            covariance = np.linalg.inv(precision)
        except np.linalg.LinAlgError:  # the model finds out by itself what its numbers are worth
            return state
        covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
        mean = (covariance @ known)[:, :, 0]
        bank = {
            "mean": mean,
            "covariance": covariance,
            "precision": precision,
            "weight": arrays["log_weight"] + _log_physical(mean, covariance),
            "age": arrays["age"],
            "kind": prior,
        }
        return runtime.publish(state, bank)


def _moments(weight: Floats, mean: Floats, precision: Floats) -> tuple[Floats, Floats]:
    """Return mean [D] and covariance [D, D] of a mixture of H Gaussians of one precision.

    A soil that the prior excludes has no weight.
    """
    share = weight / weight.sum() if weight.any() else np.full_like(weight, 1.0 / weight.size)
    middle = share @ mean
    apart = mean - middle
    return middle, np.linalg.inv(precision) + apart.T @ (share[:, None] * apart)


def _log_physical(mean: Floats, covariance: Floats) -> Floats:
    """Return the log of the mass [H] of Gaussians on c > 0 and tan phi > 0, as the model has it."""
    spread = np.sqrt(2.0 * np.diagonal(covariance, axis1=1, axis2=2)[:, :2])
    mass = [[0.5 * math.erfc(-each) for each in row] for row in (mean[:, :2] / spread).tolist()]
    return np.log(np.maximum(mass, 1e-300)).sum(1)
