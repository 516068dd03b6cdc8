# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The published forecast of the velocity: the model's, widened or replaced where it missed lately.

A posterior can be far off before a second of it is refused, and the status judges no drive before
its tenth second. What the model's last forecasts missed by shows it at once. The forecast that
replaces the model's is that the velocity stays as measured.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from terrain_estimator.estimator.persistence import MEMORY, Persistence

WORSE = 1.2
"""[1] Ratio of the mean squared errors from which on the model's forecast is not published."""
FEWEST = 3
"""[1] Errors before which the two forecasts are not compared."""
PRIOR_WEIGHT = 10.0
"""[1] Forecasts of the stated variance that the past ones are averaged with."""
LARGEST_DISTANCE = 1e6
"""[1] Squared error over the variance, beyond which a forecast counts as no worse."""
_KNOWN = FEWEST - 0.5  # weights of forecasts sum to a little less than their number


class Forecast(NamedTuple):
    """The velocity one step ahead; NaN where nothing is known of it."""

    velocity: float = math.nan  # [m/s]
    variance: float = math.nan  # [m^2/s^2]
    noise: float = 0.0  # [m^2/s^2] of the measurement to come, where the variance is without it

    def innovation(self, velocity: float, deviation: float) -> tuple[float, float]:
        """Return what a measured ``velocity`` [m/s] differs by, and the variance of that."""
        noise = deviation * deviation if self.noise else 0.0
        return velocity - self.velocity, self.variance + noise


class Hindsight(NamedTuple):
    """How the model's forecasts turned out, beside a velocity that stays; old ones fade."""

    distance: float = 0.0  # [1] weighted sum of squared errors over their variances
    square: float = 0.0  # [m^2/s^2] of the squared errors
    change: float = 0.0  # [m^2/s^2] of the squared changes of the velocity in the same steps
    weight: float = 0.0  # [1] sum of the weights

    def after(self, error: float, variance: float, change: float) -> "Hindsight":
        """Return this after a forecast that missed by ``error`` [m/s]."""
        kept = 1.0 - MEMORY
        return Hindsight(
            kept * self.distance + min(error * error / variance, LARGEST_DISTANCE),
            kept * self.square + error * error,
            kept * self.change + change * change,
            kept * self.weight + 1.0,
        )

    def corrected(self, model: Forecast, velocity: float) -> Forecast:
        """Return the better forecast, where the last measured ``velocity`` [m/s] is one too."""
        if self.weight > _KNOWN and self.change > 0.0 and self.square > WORSE * self.change:
            return Forecast(velocity, self.change / self.weight)
        excess = (self.distance + PRIOR_WEIGHT) / (self.weight + PRIOR_WEIGHT) - 1.0
        if excess <= 0.0:
            return model
        variance = model.variance + excess * (model.variance + model.noise)
        return Forecast(model.velocity, variance, model.noise)


@dataclass(slots=True)
class Forecasting:
    """The forecasts of one drive, the model's and the published one, and how they turned out."""

    persistence: Persistence = field(default_factory=Persistence)
    hindsight: Hindsight = field(default_factory=Hindsight)
    model: Forecast = field(default_factory=Forecast)  # of the velocity to come
    published: Forecast = field(default_factory=Forecast)  # of the velocity to come

    def observed(
        self, stamp_ns: int, velocity: float, deviation: float, step_s: float
    ) -> tuple[float, float]:
        """Compare the forecasts with a measured ``velocity`` [m/s].

        Returns:
            The published forecast's innovation [m/s] and its variance, NaN without a forecast.
        """
        before = self.persistence
        one_step = before.is_one_step(stamp_ns, step_s)
        self.persistence = before.observed(stamp_ns, velocity, one_step=one_step)
        if not one_step:
            return math.nan, math.nan
        error, variance = self.model.innovation(velocity, deviation)
        if math.isfinite(error) and variance > 0.0:
            self.hindsight = self.hindsight.after(error, variance, velocity - before.velocity)
        return self.published.innovation(velocity, deviation)

    def publish(self, model: Forecast | None, *, disagrees: bool) -> Forecast | None:
        """Return the forecast to publish after the model's, None without one.

        Where the estimate ``disagrees``, it is that the velocity stays.
        """
        self.model = model or Forecast()
        if disagrees:
            self.published = Forecast(*self.persistence.forecast())
        elif model is None:
            return None
        else:
            self.published = self.hindsight.corrected(model, self.persistence.velocity)
        return self.published

    def forget(self) -> None:
        """Expect nothing of the next velocity; what is known of past forecasts is kept."""
        self.model = self.published = Forecast()

    def unlink(self) -> None:
        """Forget the time and the forecasts."""
        self.persistence = self.persistence._replace(stamp_ns=None)
        self.forget()
